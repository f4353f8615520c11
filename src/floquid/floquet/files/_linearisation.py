"""A model linearised about its periodic orbit at the azimuths of one revolution, and whether they resolve it."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from typing import Literal, final

import numpy as np

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt, frozen_array, input_error, integer, positive, wrong_value
from floquid.floquet.files._lin_file import LinSignals
from floquid.floquet.matrices import balanced_units

_OF = "floquet.OpenFastLinearisation"
_TAIL = 1e-3  # of the whole: above what four digits a number leave as noise, below what moves an exponent
_CONDITION = 10.0  # of the harmonics at the azimuths; 1 where they are equally spaced
_EVEN = 1e-3  # of the spacing: what four decimals of the azimuth [rad] can tell
_BLADE = re.compile(r"\bblade (\d{1,2})\b|\bBD_(\d{1,2})\b", re.IGNORECASE)


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AzimuthResolution(Rebuilt):
    r"""The resolution of A(ψ) by the azimuths: the sizes of its harmonics.

    .. math:: s_k = \frac{\sqrt{2 - \delta_{k0}}\;\lVert D^{-1} A_k D \rVert_F}
              {\left(\frac{1}{N}\sum_j \lVert D^{-1} A(\psi_j) D \rVert_F^2\right)^{1/2}}, \qquad
              A(\psi) \approx \sum_{|k| \le n} A_k e^{ik\psi}

    with D diagonal, from the balancing of the mean of \|A\|, so that units do not matter.

    Parameters
    ----------
    harmonics
        0, 1, ..., n per revolution (harmonics,): as many as the azimuths allow.
    sizes
        s_k (harmonics,).
    tail
        The size of the highest third of the harmonics, and of what no harmonic fits, together.
    equally_spaced
        Whether the azimuths are, to a thousandth of their spacing.
    resolved
        Whether the tail is below a thousandth and the harmonics reach the passage of the blades.
    reasons
        What was found, in sentences.
    """

    harmonics: Integers
    sizes: Floats
    tail: float
    equally_spaced: bool
    resolved: bool
    reasons: tuple[str, ...]

    def __post_init__(self) -> None:
        self._freeze(dtype=np.int64, harmonics=("harmonics",))
        self._freeze(sizes=(self.harmonics.size,))


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OpenFastLinearisation(Rebuilt):
    r"""A turbine of any number of blades, linearised at azimuths of one revolution, in its own coordinates.

    .. math:: \dot x = A(\psi)\,x + B(\psi)\,u, \qquad y = C(\psi)\,x + D(\psi)\,u, \qquad \psi = \Omega t

    No multi-blade transform is made and none is needed: states in the rotating frame stay there, and the period is
    one revolution, whatever the number of blades.

    Raises InputError where a shape does not fit, a number is not finite, or the azimuths do not ascend in [0, 2π).

    Parameters
    ----------
    azimuths
        ψ, ascending in [0, 2π), no two alike (azimuths,) [rad].
    rotor_speed
        Ω, the mean over one revolution [rad/s].
    A, B, C, D
        The matrices (n, n, azimuths), (n, inputs, azimuths), (outputs, n, azimuths), (outputs, inputs, azimuths);
        None for what the files do not hold.
    states, inputs, outputs
        What the rows and columns are, in the order of the files: module by module, and in a module displacements,
        then velocities, then first-order states. Nothing is sorted: A(ψ) means the same in any order.
    operating_points
        The orbit that the model was linearised about (n, azimuths); NaN where a file has no number.
    set_aside
        The states of the files that are not in the matrices.
    description
        The title of the model.
    wind_speed
        The mean wind speed of the files [m/s]; None where one does not state it.
    """

    azimuths: Floats
    rotor_speed: float
    A: Floats
    B: Floats | None = None
    C: Floats | None = None
    D: Floats | None = None
    states: LinSignals
    inputs: LinSignals = field(default_factory=LinSignals)
    outputs: LinSignals = field(default_factory=LinSignals)
    operating_points: Floats
    set_aside: tuple[str, ...] = ()
    description: str = ""
    wind_speed: float | None = None

    def __post_init__(self) -> None:
        azimuths = frozen_array(self.azimuths, "azimuths", _OF, axes=("azimuths",))
        if azimuths.size < 3 or azimuths[0] < 0.0 or azimuths[-1] >= 2.0 * np.pi or (np.diff(azimuths) <= 0.0).any():
            got = f"has {azimuths.size} from {azimuths.min(initial=np.inf):g} to {azimuths.max(initial=-np.inf):g}"
            raise input_error("azimuths", _OF, "be three or more that ascend in [0, 2π) [rad]", got)
        object.__setattr__(self, "azimuths", azimuths)
        object.__setattr__(self, "rotor_speed", positive(self.rotor_speed, "rotor_speed", _OF, unit="rad/s"))
        n, n_inputs, n_outputs = len(self.states.names), len(self.inputs.names), len(self.outputs.names)
        for name, shape in {"A": (n, n), "B": (n, n_inputs), "C": (n_outputs, n), "D": (n_outputs, n_inputs)}.items():
            value: Floats | None = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, frozen_array(value, name, _OF, axes=(*shape, azimuths.size)))
        points = frozen_array(self.operating_points, "operating_points", _OF, axes=(n, azimuths.size), missing=True)
        object.__setattr__(self, "operating_points", points)

    @property
    def period(self) -> float:
        """The period of A(t), one revolution, 2π/Ω [s]."""
        return 2.0 * np.pi / self.rotor_speed

    @property
    def times(self) -> Floats:
        """The instants ψ/Ω of the azimuths, from the passage of azimuth zero (azimuths,) [s]."""
        return self.azimuths / self.rotor_speed

    @property
    def state_names(self) -> tuple[str, ...]:
        """The names of the states (n,)."""
        return self.states.names

    @property
    def n_blades(self) -> int | None:
        """The number of blades, as far as the names of the signals tell."""
        names = (*self.states.names, *self.set_aside, *self.inputs.names, *self.outputs.names)
        return max((int(one or other) for name in names for one, other in _BLADE.findall(name)), default=None)

    def harmonics(
        self, matrix: Literal["A", "B", "C", "D"] = "A", n_harmonics: int | None = None
    ) -> tuple[Integers, Complexes]:
        r"""The Fourier coefficients of a matrix, from the azimuths as they are.

        .. math:: A(\psi_j) \approx \sum_{k=-n}^{n} A_k\,e^{ik\psi_j} \quad \text{(least squares over } j)

        Where the azimuths are equally spaced this is their discrete Fourier transform.

        Returns the harmonics -n, ..., n (harmonics,) and the coefficients (rows, columns, harmonics), in the unit of
        the matrix. Of the `matrix` named there are `n_harmonics`, at most (azimuths - 1)/2: as many as the azimuths
        determine where not given. Raises InputError where the files do not hold the matrix, or the azimuths do not
        determine as many harmonics.
        """
        of = f"{_OF}.harmonics"
        values = getattr(self, matrix) if matrix in ("A", "B", "C", "D") else None
        if values is None:
            held = ", ".join(name for name in "ABCD" if getattr(self, name) is not None)
            raise wrong_value("matrix", of, f"be one that the files hold ({held})", matrix)
        most = _most_harmonics(self.azimuths)
        count = most if n_harmonics is None else integer(n_harmonics, "n_harmonics", of, at_least=0)
        if count > most:
            must = f"be at most {most}, which {self.azimuths.size} azimuths as they are spaced determine"
            raise input_error("n_harmonics", of, must, f"is {count}", "Linearise at more azimuths.")
        return np.arange(-count, count + 1), _coefficients(self.azimuths, values, count)

    def resolution(self) -> AzimuthResolution:
        """The sizes of the harmonics of A(ψ), and whether the azimuths resolve them.

        What lies above (azimuths - 1)/2 harmonics is folded onto lower ones, unseen. So the harmonics must reach the
        passage of the blades, and have died out before they end. The decisive check is another: the exponents of
        `every_other()` must be near those of all azimuths.
        """
        scale = balanced_units(np.abs(self.A).mean(axis=2))
        balanced = self.A * (scale[None, :, None] / scale[:, None, None])
        count = _most_harmonics(self.azimuths)
        coefficients = _coefficients(self.azimuths, balanced, count)
        left = balanced - (coefficients @ _design(self.azimuths, count).T).real
        whole = float(np.linalg.norm(balanced)) or 1.0
        weights = np.sqrt(np.where(np.arange(count + 1), 2.0, 1.0) * self.azimuths.size)
        sizes = np.linalg.norm(coefficients[:, :, count:], axis=(0, 1)) * weights / whole
        highest = np.arange(count + 1) > 2.0 * count / 3.0
        tail = float(np.hypot(np.linalg.norm(sizes[highest]), np.linalg.norm(left) / whole))
        spacing = 2.0 * np.pi / self.azimuths.size
        off = float(np.ptp(self.azimuths - spacing * np.arange(self.azimuths.size)) / (2.0 * spacing))
        return AzimuthResolution(
            harmonics=np.arange(count + 1),
            sizes=sizes,
            tail=tail,
            equally_spaced=off <= _EVEN,
            resolved=bool(tail <= _TAIL and count >= (self.n_blades or 3)),
            reasons=_reasons(self, off, tail, count),
        )

    def every_other(self) -> OpenFastLinearisation:
        """Linearisation at azimuths 0, 2, 4, …: where its exponents are near those of all, the azimuths are enough.

        Raises InputError where the number of azimuths is odd, so that half of them are not spread over the revolution,
        or below six.
        """
        count = self.azimuths.size
        if count % 2 or count < 6:
            got, remedy = f"has {count}", "Linearise at an even number of azimuths, better a multiple of four."
            raise input_error("azimuths", f"{_OF}.every_other", "have an even number of at least six", got, remedy)
        halves = {name: getattr(self, name) for name in "ABCD"}
        return replace(
            self,
            azimuths=self.azimuths[::2],
            operating_points=self.operating_points[:, ::2],
            **{name: value if value is None else value[:, :, ::2] for name, value in halves.items()},
        )


def mean_over_revolution(azimuths: Floats, values: Floats) -> float:
    """The mean of a periodic quantity from its values at the azimuths, as the harmonics of a matrix have it."""
    count = _most_harmonics(azimuths)
    return float(_coefficients(azimuths, values[None, None, :], count)[0, 0, count].real)


def _design(azimuths: Floats, count: int) -> Complexes:
    """e^{ikψ} (azimuths, harmonics), k = -count ... count."""
    return np.exp(1j * azimuths[:, None] * np.arange(-count, count + 1))


def _most_harmonics(azimuths: Floats) -> int:
    """The most harmonics that the azimuths determine without blowing up what they are given."""
    most = (azimuths.size - 1) // 2
    return next(n for n in range(most, -1, -1) if np.linalg.cond(_design(azimuths, n)) <= _CONDITION)


def _coefficients(azimuths: Floats, values: Floats, count: int) -> Complexes:
    """The coefficients (rows, columns, harmonics) of `values` (rows, columns, azimuths)."""
    found = values @ np.linalg.pinv(_design(azimuths, count)).T
    return 0.5 * (found + found[:, :, ::-1].conj())  # the values are real: conjugates to the last bit


def _reasons(model: OpenFastLinearisation, off: float, tail: float, count: int) -> tuple[str, ...]:
    n = model.azimuths.size
    words = [f"The {n} azimuths are equally spaced and tell harmonics up to {count} per revolution apart."]
    if off > _EVEN:
        gap = np.degrees(np.diff(model.azimuths, append=model.azimuths[0] + 2.0 * np.pi).max())
        spread = f"off by up to {off:.2g} of the spacing, largest gap {gap:.4g} degrees"
        fitted = f"Harmonics up to {count} per revolution are fitted to them as they are."
        words = [f"The {n} azimuths are not equally spaced ({spread}). {fitted}"]
    if count:
        above = int(2 * count / 3) + 1
        which = f"Harmonic {count}" if above == count else f"Harmonics {above} to {count}"
        end = ": the harmonics die out."
        if tail > _TAIL:
            end = f", above {_TAIL:g}: the harmonics do not die out. Linearise at more azimuths."
        words.append(f"{which} and what no harmonic fits are {tail:.2g} of the whole of A{end}")
    else:
        words.append("Not one harmonic can be told from the mean.")
    blades = model.n_blades or 3
    if count < blades:
        named = f"The {blades} blades pass" if model.n_blades else f"A rotor of {blades} blades (none is named) passes"
        folded = blades % n == 0 and off <= _EVEN
        onto = f": what happens {blades} times per revolution falls onto the mean" if folded else ""
        least = f"Use at least {2 * blades + 1}."
        words.append(f"{named} {blades} times per revolution, which {n} azimuths do not see{onto}. {least}")
    return tuple(words)
