"""The result of a record larger than memory: exponents in memory, residues in the file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import Sealed, input_error
from floquid.core import Channel, ConstantPeriod, PeriodicModel, Provenance
from floquid.large._modes import Modes
from floquid.lifting import Lifted
from floquid.lti import ModalModel, TimeResponses
from floquid.periodic import assemble

LARGE_VERSION = 2
LARGEST = 2.0**28  # bytes of a model in memory: the least that machines which need `identify_large` have to spare
ANSWERS = {True: "passes", False: "fails", None: "no answer"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LargeResult(Sealed):
    """Exponents of a record larger than memory, and where its residues are.

    Parameters
    ----------
    path
        The file that holds all of it.
    period
        The period [s].
    exponents, exponent_std
        The exponent of each mode on the upper half (modes,) [1/s], on the branch whose zeroth harmonic is strongest.
        The deviation is that of the real part and i times that of the imaginary part.
    covariance
        That of decays and angular frequencies, mode by mode (parameters, parameters) [1/s²].
    real
        True where the multiplier is real: such a mode has no conjugate (modes,).
    noise
        The deviation of the noise (channels,) [units of the channels].
    channels
        One `Channel` a row of the residues.
    phase
        The phase of the first sample, in periods.
    residue_spread, residue_slope
        The covariance of the residues of all multipliers, each conjugate after its partner, for unit noise and known
        exponents, and G: errors δs of ln μ move the residues R by -G diag(δs) R (order, order).
    n_phases, n_cycles, sweeps
        Samples a period, periods, and sweeps over the record.
    last_step
        The last step of the exponents over their deviations, the largest: its square is left.
    source
        Where the record came from.
    passed
        True where a part of the record passed all checks of `identify` and has these modes; None where it shows none,
        or had no room in memory.
    failed
        True where the part was refused or failed, or a mode that it should show is none there.
    reasons
        What speaks against the model, a sentence each.
    part
        The channels and periods of that part.
    """

    kind: ClassVar[str] = "large"  # by it the functions for a result are found
    path: Path
    period: float
    exponents: Complexes
    exponent_std: Complexes
    covariance: Floats
    real: np.ndarray
    noise: Floats
    channels: tuple[Channel, ...]
    phase: float
    residue_spread: Complexes
    residue_slope: Complexes
    n_phases: int
    n_cycles: int
    sweeps: int
    last_step: float
    source: str = ""
    passed: bool | None = None
    failed: bool = False
    reasons: tuple[str, ...] = ()
    part: tuple[int, int] = (0, 0)

    @property
    def multipliers(self) -> Complexes:
        """Floquet multipliers e^{λT} (modes,)."""
        return np.exp(self.exponents * self.period)

    @property
    def modes(self) -> Modes:
        """Logarithms of the multipliers, as the columns of the fit have them."""
        return Modes(np.log(self.multipliers), tuple(self.real.tolist()))

    def residues(self, channels: slice | int = slice(None)) -> Complexes:
        r"""Residues of some channels, read from the file (channels, modes, phases) [units of the channels].

        .. math:: y_c(\tau_k + nT) = a_{c,k} + \sum_r 2 \Re R_{c,r,k}\, \mu_r^n

        from the first sample on; without the factor 2 for a real multiplier. `channels` are a slice or a number.
        """
        import h5py

        with h5py.File(self.path, "r") as file:
            return np.asarray(file["residues"][channels])

    @property
    def model(self) -> PeriodicModel:
        """The periodic model of all channels, made of the residues in the file each time (`model_of`).

        Raises InputError where it has no room in memory.
        """
        return self.model_of()

    def model_of(self, channels: slice = slice(None)) -> PeriodicModel:
        r"""The periodic model of some `channels`, with phase zero that of the clock: what `identify` makes of them.

        .. math:: B_{r,m} = \frac1P \sum_k R_{r,k}\, e^{-(\lambda_r + i m \omega) t_k}

        t_k are the times of the phases after phase zero [s]. Deviations hold the noise of each channel and the errors
        of the exponents. Bands of harmonics and branches are those of these channels.

        Raises InputError where it has no room in memory.
        """
        places = range(*channels.indices(len(self.channels)))
        modes = self.modes
        size = 32.0 * modes.order**2 * self.n_phases * len(places)
        if size > LARGEST or not places:
            most = int(len(places) * LARGEST / max(size, 1.0))
            got = f"are {len(places)} of {modes.order} modes and {self.n_phases} phases"
            remedy = f"Take some: `result.model_of(slice(0, {max(most, 1)}))`."
            raise input_error("channels", "LargeResult.model_of", f"be 1 to {most}", got, remedy)
        found = _modelled(
            modes,
            self.residues(channels),
            spread=self.residue_spread,
            slope=self.residue_slope,
            covariance=self.covariance,
            noise=self.noise[channels],
            period=self.period,
            phase=self.phase,
            channels=self.channels[channels],
            source=self.source,
        )
        return replace(found, point={"speed_rpm": 60.0 / self.period})

    def summary(self) -> str:
        """The modes with deviations, the noise, and the verdict of the checks of a part: the text of the terminal."""
        periods = f"{self.n_cycles} periods of {self.period:.6g} s"
        lines = [
            f"{len(self.channels)} channels, {self.n_phases} samples a period, {periods}; {self.sweeps} sweeps.",
            "",
            f"{'λ [1/s]':>34}   {'f [Hz]':>12} {'ζ [%]':>10}",
        ]
        for value, std in zip(self.exponents, self.exponent_std, strict=True):
            exponent = f"{value.real:.6g} ± {std.real:.1g} + ({value.imag:.8g} ± {std.imag:.1g})i"
            size = abs(value)
            lines.append(f"{exponent:>34}   {size / (2 * np.pi):>12.6g} {-100 * value.real / size:>10.4g}")
        low, high = self.noise.min(), self.noise.max()
        size = f"{self.part[0]} of {len(self.channels)} channels, {self.part[1]} of {self.n_cycles} periods"
        lines += ["", f"Noise: {low:.3g} to {high:.3g} in the units of the channels, taken for white."]
        return "\n".join([*lines, f"Checks of a part ({size}): {ANSWERS[self.passed]}.", *self.reasons])


def opened(file: Path) -> LargeResult:
    """The result that `identify_large` wrote to a file, its residues left there."""
    import h5py

    with h5py.File(file, "r") as stored:
        said = stored.attrs
        names = ("exponents", "exponent_std", "covariance", "real", "noise", "residue_spread", "residue_slope")
        words = zip(*(stored[f"channels/{name}"].asstr()[()].tolist() for name in ("name", "unit")), strict=True)
        return LargeResult(
            path=file,
            period=float(said["period"]),
            channels=tuple(Channel(name=name, unit=unit) for name, unit in words),
            phase=ConstantPeriod(period=said["period"], origin=said["origin"]).phase(float(said["start"])),
            n_phases=int(said["phases"]),
            n_cycles=int(said["cycles"]),
            sweeps=int(said["sweeps"]),
            last_step=float(said["last_step"]),
            source=str(said["source"]),
            **_verdict(stored),
            **{name: stored[name][()] for name in names},
        )


def _verdict(stored: Any) -> dict[str, Any]:
    """The verdict of the checks of a part in a file; none of one that was not checked yet."""
    if "reasons" not in stored:
        return {}
    said = stored.attrs
    return {
        "passed": {1: True, 0: False}.get(int(said["passed"])),
        "failed": bool(said["failed"]),
        "reasons": tuple(stored["reasons"].asstr()[()].tolist()),
        "part": (int(said["part_channels"]), int(said["part_cycles"])),
    }


def _modelled(
    modes: Modes,
    residues: Complexes,
    *,
    spread: Complexes,
    slope: Complexes,
    covariance: Floats,
    noise: Floats,
    period: float,
    phase: float,
    channels: tuple[Channel, ...],
    source: str,
) -> PeriodicModel:
    """The model that `assemble` makes of residues (channels, modes, phases) that begin at a phase of the clock."""
    count, _, phases = residues.shape
    all_of = np.repeat(residues.transpose(1, 0, 2).reshape(len(modes.logs), -1), [1 if r else 2 for r in modes.real], 0)
    conjugates = np.ones(modes.order, bool)
    conjugates[modes.places] = False
    all_of[conjugates] = all_of[conjugates].conj()
    by = modes.by_parameters
    by = np.concatenate([by.real, by.imag])
    modal = ModalModel(
        multipliers=modes.multipliers,
        residues=all_of[:, :, None],
        dt=period,
        covariance=by @ covariance @ by.T,
        residue_spread=spread[None],
        residue_slope=slope[None],
    )
    # The expansion asks the lifted responses for their noise and phases alone: the values stay on the disk.
    lifted = Lifted(
        responses=TimeResponses(
            values=np.zeros((count * phases, 1, 1)), dt=period, noise=np.repeat(noise, phases)[:, None]
        ),
        channels=channels,
        n_phases=phases,
        first_phase=phase,
        provenance=Provenance(sources=(source,)),
    )
    return assemble(modal, lifted)
