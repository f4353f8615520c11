"""The result of a record larger than memory: exponents in memory, residues in the file."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from floquid._arrays import Complexes, Floats
from floquid._checks import Sealed, input_error
from floquid.io import readable_file

FORMAT = "floquid-large"
LACKS = (
    "There are no A(t), checks and whitening on this path: the residual was not looked at for further modes or colour. "
    "Nothing tested the period either: a wrong one makes several modes of equal decay, whose deviations look fine."
)


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
        The names of the channels.
    n_phases, n_cycles, sweeps
        Samples a period, periods, and sweeps over the record.
    last_step
        The last step of the exponents over their deviations, the largest: its square is left.
    """

    path: Path
    period: float
    exponents: Complexes
    exponent_std: Complexes
    covariance: Floats
    real: np.ndarray
    noise: Floats
    channels: tuple[str, ...]
    n_phases: int
    n_cycles: int
    sweeps: int
    last_step: float

    @property
    def multipliers(self) -> Complexes:
        """Floquet multipliers e^{λT} (modes,)."""
        return np.exp(self.exponents * self.period)

    def residues(self, channels: slice | int = slice(None)) -> Complexes:
        r"""Residues of some channels, read from the file (channels, modes, phases) [units of the channels].

        .. math:: y_c(\tau_k + nT) = a_{c,k} + \sum_r 2 \Re R_{c,r,k}\, \mu_r^n

        from the first sample on; without the factor 2 for a real multiplier. `channels` are a slice or a number.
        """
        import h5py

        with h5py.File(self.path, "r") as file:
            return np.asarray(file["residues"][channels])

    def summary(self) -> str:
        """The modes with deviations, the noise, and what this path does not do: the text of the terminal."""
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
        return "\n".join([*lines, "", f"Noise: {low:.3g} to {high:.3g} in the units of the channels.", LACKS])


def open_result(path: str | PathLike[str]) -> LargeResult:
    """The result that `identify_large` wrote to a file, its residues left there.

    `path` is by custom `result.h5`. Raises InputError where it is no such file.
    """
    import h5py

    file = readable_file(path, of="open_result")
    try:
        with h5py.File(file, "r") as opened:
            if str(opened.attrs.get("format")) != FORMAT:
                raise OSError(f"its format is not {FORMAT}")
            said = opened.attrs
            arrays = {name: opened[name][()] for name in ("exponents", "exponent_std", "covariance", "real", "noise")}
            return LargeResult(
                path=file,
                period=float(said["period"]),
                channels=tuple(opened["channels"].asstr()[()].tolist()),
                n_phases=int(said["phases"]),
                n_cycles=int(said["cycles"]),
                sweeps=int(said["sweeps"]),
                last_step=float(said["last_step"]),
                **arrays,
            )
    except (OSError, KeyError, ValueError) as error:
        must = "be a result that `identify_large` wrote"
        raise input_error("path", "open_result", must, f"{file} is none ({str(error).splitlines()[0]})") from None
