"""The harmonic state space of a periodic system, and its harmonic transfer function."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt, frozen_array, input_error, integer, positive
from floquid.floquet.control._system import Matrices, PeriodicSystem, with_inputs
from floquid.floquet.hill_method import STEPS, block_toeplitz, hill, most_harmonics, refuse_undamped, smoothed, speeds
from floquid.floquet.matrices import AbstractPeriodicMatrix, FunctionMatrix, checked_tolerance, fourier, reach

_LARGEST = 2500  # rows of the lifted state matrix
_OF_JUMPS = 64  # harmonics that are given by default where jumps or kinks make them go on without end


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HarmonicTransfer(Rebuilt):
    r"""The response of a periodic system to one exponential: exponentials at all harmonics beside it.

    .. math:: u(t) = u\, e^{i\Omega t} \quad\Rightarrow\quad y(t) = \sum_k H_k(i\Omega)\, u\, e^{i(\Omega + k\omega) t}

    Parameters
    ----------
    omega
        Ω (lines,) [rad/s].
    values
        H_k(iΩ) (outputs, inputs, harmonics, lines).
    harmonics
        k, ascending (harmonics,).
    period
        T [s].
    n_harmonics
        The truncation N that was needed.
    error
        The largest change of any harmonic at any line from the truncation before (outputs, inputs).
    inputs, outputs
        Their names.
    """

    omega: Floats
    values: Complexes
    harmonics: Integers
    period: float
    n_harmonics: int
    error: Floats
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def __post_init__(self) -> None:
        self._freeze(omega=("lines",))
        self._freeze(dtype=np.int64, harmonics=("harmonics",))
        sizes = (len(self.outputs), len(self.inputs))
        self._freeze(dtype=np.complex128, values=(*sizes, len(self.harmonics), len(self.omega)))
        self._freeze(finite=False, error=sizes)
        object.__setattr__(self, "period", positive(self.period, "period", "HarmonicTransfer", unit="s"))

    @property
    def fundamental(self) -> float:
        """ω = 2π/T [rad/s]."""
        return 2.0 * np.pi / self.period


def harmonic_transfer(
    system: PeriodicSystem,
    omega: ArrayLike,
    *,
    n_harmonics: int | None = None,
    tolerance: float = 1e-8,
    raises: bool = True,
) -> HarmonicTransfer:
    r"""The harmonic transfer function on the imaginary axis.

    .. math:: H_k(i\Omega) = \left[\mathcal C\,(i\Omega - \mathcal A + \mathcal N)^{-1} \mathcal B
              + \mathcal D\right]_{k,0}

    Wereley and Hall 1990; Möllerstedt and Bernhardsson 2000. That of an unstable system is one too, but no steady
    response. Where A(t) jumps, it is first made smooth by a periodic change of coordinates, as in `hill`.

    Raises InputError where the system has no inputs, or a line meets an undamped exponent, modulo ω. So it does where
    the values have not settled and `raises` is true.

    Parameters
    ----------
    system
        The periodic system, with inputs.
    omega
        Ω (lines,) [rad/s].
    n_harmonics
        The highest harmonic k that is given. By default all that matter; 64 where a matrix has breaks, for then the
        harmonics of the response fall off slowly and never end, however well each of them is known.
    tolerance
        Of the largest value from an input to an output: the largest change from one truncation to the next, half as
        large again or larger by the highest strong harmonic of a matrix, that passes, from 1e-14 to 1e-2.
    raises
        Whether a truncation that does not suffice is an error; else see `error`.
    """
    of = "floquet.harmonic_transfer"
    with_inputs(system, of)
    lines = frozen_array(omega, "omega", of, axes=("lines",))
    if lines.size:
        refuse_undamped(hill(system.A, raises=False), lines, of)
    return _respond(system, lines, n_harmonics, tolerance, raises, of)


def _respond(
    system: PeriodicSystem, omega: Floats, n_harmonics: int | None, tolerance: float, raises: bool, of: str
) -> HarmonicTransfer:
    """The responses to e^{iΩt} in each input, settled to `tolerance`."""
    accuracy = checked_tolerance(tolerance, of, largest=1e-2)
    wanted = None if n_harmonics is None else integer(n_harmonics, "n_harmonics", of, at_least=0)
    lifted = with_inputs(system, of)
    jumps = any(np.size(matrix.breaks) for matrix in lifted)
    lifted = _smooth(*lifted)
    wanted, truncations = _truncations(lifted, jumps, wanted, accuracy, of)
    highest = truncations[-1] if wanted is None else wanted
    shape = (system.n_outputs, system.n_inputs, 2 * highest + 1, len(omega))
    values = np.zeros(shape, dtype=np.complex128)
    change = np.full((*shape[:2], len(omega)), np.inf)
    left, used, first = np.arange(len(omega)), truncations[0], True
    for truncation in truncations:
        if not left.size:
            break
        used = truncation
        now = _solved(lifted, system, omega[left], truncation, highest, of)
        if not first:
            change[..., left] = np.abs(now - values[..., left]).max(axis=2)
        values[..., left], first = now, False
        largest = np.abs(values).max(axis=(2, 3))[..., None]
        left = left[(change[..., left] > accuracy * largest).any(axis=(0, 1))]
    error = change.max(axis=2, initial=0.0)
    if left.size and raises:
        must = f"have a response that settles to {accuracy:g} of its largest harmonic"
        got = f"at Ω = {omega[left[0]]:g} rad/s it still changes by {error.max():.3g} at {used} harmonics"
        remedy = (
            "Keep off the undamped exponents, name the jumps of callables in `breaks`, raise `tolerance`, or pass "
            "`raises=False` and look at `error`."
        )
        raise input_error("omega" if not np.isfinite(values).all() else "system", of, must, got, remedy)
    kept = min(highest, used)
    values = values[:, :, highest - kept : highest + kept + 1]
    return HarmonicTransfer(
        omega=omega,
        values=values,
        harmonics=np.arange(-kept, kept + 1),
        period=system.period,
        n_harmonics=used,
        error=error,
        inputs=system.inputs,
        outputs=system.outputs,
    )


def _solved(lifted: Matrices, system: PeriodicSystem, omega: Floats, truncation: int, reach: int, of: str) -> Complexes:
    """The outputs' harmonics up to `reach` at one truncation (outputs, inputs, harmonics, lines)."""
    A, B, C, D = lifted
    n_inputs = system.n_inputs
    matrix = block_toeplitz(fourier(A, 2 * truncation), truncation)
    matrix -= np.diag(speeds(system.n_states, truncation, 2.0 * np.pi / system.period))
    drive = fourier(B, truncation).transpose(2, 0, 1).reshape(-1, n_inputs)
    inner = np.empty((len(drive), n_inputs, len(omega)), dtype=np.complex128)
    diagonal = np.eye(len(drive))
    for index, line in enumerate(omega.tolist()):
        try:
            inner[..., index] = np.linalg.solve(1j * line * diagonal - matrix, drive)
        except np.linalg.LinAlgError:
            must = "keep off the exponents"
            raise input_error("omega", of, must, f"Ω = {line:g} rad/s is one of an undamped mode") from None
    out = np.zeros((system.n_outputs, n_inputs, 2 * reach + 1, len(omega)), dtype=np.complex128)
    kept = min(truncation, reach)
    middle = slice(reach - kept, reach + kept + 1)
    rows = slice((truncation - kept) * system.n_outputs, (truncation + kept + 1) * system.n_outputs)
    read = block_toeplitz(fourier(C, 2 * truncation), truncation)[rows]
    through = np.tensordot(read, inner, 1).reshape(2 * kept + 1, system.n_outputs, n_inputs, len(omega))
    out[:, :, middle] = through.transpose(1, 2, 0, 3) + fourier(D, kept)[..., None]
    return out


def _smooth(
    A: AbstractPeriodicMatrix, B: AbstractPeriodicMatrix, C: AbstractPeriodicMatrix, D: AbstractPeriodicMatrix
) -> Matrices:
    """The system in coordinates z of x = P z in which A is smooth, if it can be."""
    smooth = smoothed(A)
    if smooth is None:
        return A, B, C, D
    period, cuts = A.period, smooth.matrix.breaks
    change = FunctionMatrix(function=smooth.change, period=period, breaks=cuts, vectorised=True)
    back = FunctionMatrix(
        function=lambda times: np.linalg.inv(smooth.change(times)), period=period, breaks=cuts, vectorised=True
    )
    return smooth.matrix, back @ B, C @ change, D


def _truncations(
    lifted: Matrices, jumps: bool, wanted: int | None, tolerance: float, of: str
) -> tuple[int | None, list[int]]:
    """The highest harmonic to give, and truncations that meet more and more of the matrices' strong harmonics."""
    n = lifted[0].shape[0]
    found = a, b, c, d = tuple(reach(matrix, tolerance) for matrix in lifted)
    # An input at a harmonic of B is carried on by A and read at one of C beside it; D counts for the whole response.
    lowest = max(a.highest, b.highest + c.highest, d.highest if wanted is None else 0)
    step = max(2, a.strong, b.strong, c.strong)
    steps = STEPS if all(lines.ends for lines in found) else 1
    most = max(most_harmonics(n, _LARGEST), min(lowest + steps * step, (_LARGEST // n - 1) // 2))
    if wanted is None and jumps:
        wanted = max(0, min(_OF_JUMPS, most - 2 - step))
    out = [max(4, lowest, 0 if wanted is None else wanted + 2)]
    least = out[0] + step
    if least > most:
        must = f"keep (2 N + 1) n within {_LARGEST}"
        got = f"{least} harmonics of {n} states are {(2 * least + 1) * n}"
        remedy = "Reduce the states or the harmonics of the matrices, ask for fewer harmonics, or raise `tolerance`."
        raise input_error("system" if out[0] == lowest else "n_harmonics", of, must, got, remedy)
    while out[-1] + step <= most:
        out.append(min(most, out[-1] + max(step, out[-1] // 2)))
    return wanted, out
