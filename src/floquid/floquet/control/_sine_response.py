"""The steady response of a periodic system to a sine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats, Integers
from floquid._checks import Rebuilt, finite, frozen_array, input_error, positive
from floquid.floquet.control._harmonic_state_space import respond
from floquid.floquet.control._system import PeriodicSystem, checked_system
from floquid.floquet.hill_method import growth_doubt, hill, refuse_undamped


@final
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SineResponse(Rebuilt):
    r"""The steady response to u(t) = Re(U e^{iΩt}).

    .. math:: y(t) = \mathrm{Re} \sum_k Y_k\, e^{i(\Omega + k\omega) t}

    Parameters
    ----------
    omega
        Ω [rad/s].
    amplitude
        U (inputs,).
    values
        Y_k (outputs, harmonics).
    harmonics
        k, ascending (harmonics,).
    period
        T [s].
    n_harmonics
        The truncation N that was needed.
    error
        The largest change of a harmonic from the truncation before (outputs,).
    inputs, outputs
        Their names.
    """

    omega: float
    amplitude: Complexes
    values: Complexes
    harmonics: Integers
    period: float
    n_harmonics: int
    error: Floats
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    def __post_init__(self) -> None:
        of, put = "SineResponse", object.__setattr__
        put(self, "omega", finite(self.omega, "omega", of, unit="rad/s"))
        put(self, "period", positive(self.period, "period", of, unit="s"))
        self._freeze(dtype=np.int64, harmonics=("harmonics",))
        axes = (len(self.outputs), len(self.harmonics))
        self._freeze(dtype=np.complex128, amplitude=(len(self.inputs),), values=axes)
        self._freeze(finite=False, error=axes[:1])

    @property
    def frequencies(self) -> Floats:
        """Ω + kω (harmonics,) [rad/s]; a negative one is that of the conjugate."""
        return np.asarray(self.omega + 2.0 * np.pi / self.period * self.harmonics, dtype=np.float64)

    def at(self, times: ArrayLike) -> Floats:
        """The outputs at `times` [s] of any shape (outputs, ...): the sum of the harmonics that are there.

        Where the system jumps, the harmonics beyond are missed, about the size of the last ones times their number.
        """
        instants = np.asarray(times, dtype=np.float64)
        waves = np.exp(1j * np.multiply.outer(self.frequencies, instants))
        return np.real(np.tensordot(self.values, waves, 1))


def sine_response(
    system: PeriodicSystem,
    omega: float,
    amplitude: ArrayLike = 1.0,
    *,
    n_harmonics: int | None = None,
    tolerance: float = 1e-10,
    raises: bool = True,
) -> SineResponse:
    r"""The steady response to a sine at the inputs.

    .. math:: u(t) = \mathrm{Re}(U e^{i\Omega t}) \quad\Rightarrow\quad
              y(t) = \mathrm{Re} \sum_k H_k(i\Omega)\, U\, e^{i(\Omega + k\omega) t}

    Wereley and Hall 1990. Without damping this is the response that repeats; a free response stays beside it.

    Raises InputError where the system is unstable, and has no steady response; Ω meets an undamped exponent, modulo ω;
    or as in `harmonic_transfer`.

    Parameters
    ----------
    system
        The periodic system, with inputs.
    omega
        Ω [rad/s].
    amplitude
        U, complex, one for all inputs or one for each (inputs,).
    n_harmonics
        The highest harmonic k that is given; by default as in `harmonic_transfer`.
    tolerance, raises
        As in `harmonic_transfer`.
    """
    of = "floquet.sine_response"
    speed = finite(omega, "omega", of, unit="rad/s")
    checked_system(system, of, inputs=False)
    size = amplitude if np.ndim(amplitude) else np.full(system.n_inputs, amplitude)
    column = frozen_array(size, "amplitude", of, axes=(system.n_inputs,), dtype=np.complex128)
    _refuse_without_steady_state(system, speed, of)
    found = respond(system, np.array([speed]), column[:, None], n_harmonics, tolerance, raises, of)
    return SineResponse(
        omega=speed,
        amplitude=column,
        values=found.values[:, 0, :, 0],
        harmonics=found.harmonics,
        period=system.period,
        n_harmonics=found.truncation,
        error=found.error[:, 0],
        inputs=system.inputs,
        outputs=system.outputs,
    )


def _refuse_without_steady_state(system: PeriodicSystem, omega: float, of: str) -> None:
    """Refuse an unstable system, and a sine at an exponent on the imaginary axis."""
    modes = hill(system.A)
    growth = modes.exponents.real
    if (growth > growth_doubt(modes)).any():
        remedy = "It has no steady response; `harmonic_transfer` gives the transfer function all the same."
        raise input_error("system", of, "be stable", f"has an exponent of real part {growth.max():.6g} 1/s", remedy)
    refuse_undamped(modes, np.array([omega]), of)
