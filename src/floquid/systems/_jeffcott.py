"""The Jeffcott rotor of Allen 2009, section 3: an anisotropic shaft on anisotropic supports."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from floquid import floquet
from floquid._arrays import Complexes, Floats
from floquid._checks import finite, input_error, integer, positive, wrong_value
from floquid.core import Channel, ConstantPeriod, Provenance, Record

DampingForm = Literal["identity", "support"]

LONGEST = 10**10  # samples of each channel beyond which a record is a slip of the keyboard


@dataclass(frozen=True, slots=True, kw_only=True)
class JeffcottRotor:
    r"""A point mass on two springs that turn with the shaft, on a massless turntable held by two fixed springs.

    .. math::
        \ddot u + C \dot u + K(t)\, u = 0, \qquad u = [X, Y]^T, \qquad C = c_f I

        K = K_R' - K_R' (K_R' + K_F)^{-1} K_R', \qquad K_R' = R^T K_R R, \qquad
        R = \begin{bmatrix} \cos\Omega t & \sin\Omega t \\ -\sin\Omega t & \cos\Omega t \end{bmatrix}

    (Allen 2009, eq. 22, corrected: as printed the rotation is the other way round, R K_R Rᵀ, and the damping is
    C = c_f K_F, which does not give the paper's own exponents.) K is the turning springs K_R = diag(`rotor_x`,
    `rotor_y`) and the fixed springs K_F = diag(`support_x`, `support_y`) in series. R takes fixed to turning
    coordinates, the shaft is at angle Ωt, and in the fixed frame everything repeats itself every half revolution.

    All is without dimension: time in 1/ω_n, ω_n = (k_Fx/m)^½; stiffness in k_Fx. The defaults are the paper's.

    Raises InputError where a stiffness or the speed is not positive, the damping is negative, or the form of damping is
    unknown.

    Parameters
    ----------
    rotor_x, rotor_y
        Stiffness of the shaft along its two axes, k_Rx/k_Fx and k_Ry/k_Fx.
    support_x, support_y
        Stiffness of the support along the fixed axes, k_Fx/k_Fx and k_Fy/k_Fx.
    damping
        The damping factor c_f, not negative.
    speed
        The speed of the shaft, Ω/ω_n.
    damping_form
        "identity" for C = c_f I; "support" for C = c_f K_F, as the paper prints it.
    """

    rotor_x: float = 1.0
    rotor_y: float = 1.5
    support_x: float = 1.0
    support_y: float = 2.0
    damping: float = 0.004
    speed: float = 0.5
    damping_form: DampingForm = "identity"

    def __post_init__(self) -> None:
        of = "JeffcottRotor"
        for name in ("rotor_x", "rotor_y", "support_x", "support_y", "speed"):
            object.__setattr__(self, name, positive(getattr(self, name), name, of))
        object.__setattr__(self, "damping", _not_negative(self.damping, "damping", of))
        if self.damping_form not in get_args(DampingForm):
            words = " or ".join(f'"{form}"' for form in get_args(DampingForm))
            raise wrong_value("damping_form", of, f"be {words}", self.damping_form)

    @property
    def period(self) -> float:
        """The period π/Ω of A(t) and C(t): half a revolution of the shaft."""
        return np.pi / self.speed

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The outputs: displacements of the mass, X and Y, and of the turntable, X_tt and Y_tt."""
        return tuple(
            Channel(name=f"{axis}{suffix}", quantity="displacement", location=location, direction=axis)
            for suffix, location in (("", "mass"), ("_tt", "turntable"))
            for axis in ("X", "Y")
        )

    def stiffness(self, t: ArrayLike) -> Floats:
        """The stiffness K(t) of the two sets of springs in series (..., 2, 2) (eq. 22)."""
        return self._stiffness_at(self.speed * np.asarray(t, dtype=np.float64))

    def system(self, t: ArrayLike) -> Floats:
        """The state matrix A(t) = [[0, I], [-K, -C]] in the states [X, Y, X', Y'] (..., 4, 4)."""
        stiffness = self.stiffness(t)
        a = np.zeros((*stiffness.shape[:-2], 4, 4))
        a[..., :2, 2:] = np.eye(2)
        a[..., 2:, :2] = -stiffness
        a[..., 2:, 2:] = -self._damping_matrix()
        return a

    def outputs(self, t: ArrayLike) -> Floats:
        """The output matrix C(t) = [[I, 0], [M, 0]] of [X, Y, X_tt, Y_tt] (..., 4, 4).

        The turntable is massless, so the forces on it balance: u_tt = M u with M = (K_R' + K_F)^-1 K_R'.
        """
        m, _, _ = self._turntable(t)
        c = np.zeros((*m.shape[:-2], 4, 4))
        c[..., :2, :2] = np.eye(2)
        c[..., 2:, :2] = m
        return c

    def turntable_system(self, t: ArrayLike) -> Floats:
        """The state matrix A_tt = (S' + S A) S^-1 in the states [X_tt, Y_tt, X_tt', Y_tt'] (..., 4, 4).

        S = [[M, 0], [M', M]] takes the states of the mass to those of the turntable, u_tt = M u, at the times `t` [s].
        """
        m, rate, second = self._turntable(t)
        s, s_rate = np.zeros((2, *m.shape[:-2], 4, 4))
        s[..., :2, :2] = s[..., 2:, 2:] = m
        s[..., 2:, :2] = rate
        s_rate[..., :2, :2] = s_rate[..., 2:, 2:] = rate
        s_rate[..., 2:, :2] = second
        return (s_rate + s @ self.system(t)) @ np.linalg.inv(s)

    def frozen_frequencies(self, angle: ArrayLike) -> Floats:
        """The undamped natural frequencies with the shaft held at `angle` [rad], ascending (..., 2)."""
        return np.sqrt(np.linalg.eigvalsh(self._stiffness_at(np.asarray(angle, dtype=np.float64))))

    def exponents(self) -> Complexes:
        """The four Floquet exponents on the principal branch, from the equations (modes,)."""
        return floquet.exponents(floquet.FunctionMatrix(function=self.system, period=self.period, vectorised=True))

    def simulate(
        self,
        *,
        n_periods: int = 1024,
        samples_per_period: int = 50,
        noise: float = 0.02,
        seed: int = 0,
        impulse_deg: float = 45.0,
        first_phase: float = 0.0,
    ) -> Record:
        r"""The response to a unit impulse, as a record of X, Y, X_tt and Y_tt; phase zero is at time zero.

        .. math:: y(t) = C(t)\, \Phi(t, t_0)\, [0, 0, \cos\alpha, \sin\alpha]^T, \qquad t_0 = \phi T

        One period is integrated; the others follow from the monodromy matrix, to a relative error of about 1e-13 a
        period. The defaults are the paper's experiment (Allen 2009, section 3; its sampling interval of 0.126 is
        2π/50, rounded).

        Raises InputError where a number is out of its range, or the response of an unstable rotor leaves the range of
        floating point.

        Parameters
        ----------
        n_periods, samples_per_period
            The number of periods, and of samples in each.
        noise
            Standard deviation of the white Gaussian noise in each channel, as a fraction of the largest free response
            in that channel.
        seed
            Seed of the noise, for `numpy.random.default_rng`.
        impulse_deg
            The direction α of the impulse on the mass, from X towards Y [deg].
        first_phase
            The phase φ of the period at which the impulse is given and the record begins, in [0, 1).
        """
        of = "JeffcottRotor.simulate"
        periods = integer(n_periods, "n_periods", of, at_least=1)
        samples = integer(samples_per_period, "samples_per_period", of, at_least=1)
        if periods * samples > LONGEST:
            must = f"make at most {LONGEST:.0e} samples"
            raise input_error("n_periods", of, must, f"is {periods} of {samples} samples", "Ask for less.")
        level = _not_negative(noise, "noise", of, remedy="It is a fraction: 0.02 is 2 %.")
        generator = np.random.default_rng(integer(seed, "seed", of, at_least=0))
        direction = np.deg2rad(finite(impulse_deg, "impulse_deg", of, unit="deg"))
        phase = finite(first_phase, "first_phase", of)
        if not 0.0 <= phase < 1.0:
            raise input_error("first_phase", of, "lie in [0, 1), in periods", f"is {phase:g}")
        start = phase * self.period
        values = free_response(
            self.system,
            self.outputs,
            np.array([0.0, 0.0, np.cos(direction), np.sin(direction)]),
            period=self.period,
            n_periods=periods,
            samples_per_period=samples,
            start=start,
        )
        if not np.isfinite(values).all():
            must, got = "end before the response overflows", f"is {periods}, and this rotor is unstable"
            raise input_error("n_periods", of, must, got, "Take fewer periods or another speed.")
        if level > 0.0:
            largest = np.abs(values).max(axis=1, keepdims=True)
            if not level * largest.max() < 1e300:
                raise input_error("noise", of, "leave the response in range", f"is {level:g}", "0.02 is 2 %.")
            values = values + level * largest * generator.standard_normal(values.shape)
        values.flags.writeable = False
        words = (
            f"simulation of {self!r}: unit impulse at {impulse_deg:g} deg and phase {phase:g}, {periods} periods of "
            f"{samples} samples, noise {100.0 * level:g} % of the largest response in each channel, seed {seed}"
        )
        return Record(
            values=values,
            sample_rate=samples / self.period,
            channels=self.channels,
            clock=ConstantPeriod(period=self.period),
            start=start,
            provenance=Provenance(sources=(words,)),
        )

    def _damping_matrix(self) -> Floats:
        if self.damping_form == "support":
            return self.damping * np.diag([self.support_x, self.support_y])
        return self.damping * np.eye(2)

    def _rotor(self, angle: Floats) -> tuple[Floats, Floats]:
        """K_R' and its derivative by twice the angle (..., 2, 2), from the half sum and difference of stiffnesses."""
        mean, half = 0.5 * (self.rotor_x + self.rotor_y), 0.5 * (self.rotor_x - self.rotor_y)
        c, s = half * np.cos(2.0 * angle), half * np.sin(2.0 * angle)
        varying = np.stack([np.stack([c, s], axis=-1), np.stack([s, -c], axis=-1)], axis=-2)
        turned = np.stack([np.stack([-s, c], axis=-1), np.stack([c, s], axis=-1)], axis=-2)
        return mean * np.eye(2) + varying, turned

    def _stiffness_at(self, angle: Floats) -> Floats:
        rotor, _ = self._rotor(angle)
        support = np.diag([self.support_x, self.support_y])
        series = support @ np.linalg.solve(rotor + support, rotor)
        return 0.5 * (series + np.swapaxes(series, -1, -2))

    def _turntable(self, t: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """M of u_tt = M u, and its first two derivatives in time (..., 2, 2)."""
        # With N = (K_R' + K_F)^-1, M = I - N K_F and N' = -N K_R'' N, the primes of the rest being derivatives.
        rotor, turned = self._rotor(self.speed * np.asarray(t, dtype=np.float64))
        support = np.diag([self.support_x, self.support_y])
        mean = 0.5 * (self.rotor_x + self.rotor_y) * np.eye(2)
        rate = 2.0 * self.speed * turned
        second = -((2.0 * self.speed) ** 2) * (rotor - mean)
        n = np.linalg.inv(rotor + support)
        n_rate = -n @ rate @ n
        n_second = -(n_rate @ rate @ n + n @ second @ n + n @ rate @ n_rate)
        return np.eye(2) - n @ support, -n_rate @ support, -n_second @ support


def _not_negative(value: object, argument: str, of: str, *, remedy: str = "") -> float:
    number = finite(value, argument, of, remedy=remedy)
    if number < 0.0:
        raise input_error(argument, of, "not be negative", f"is {number:g}", remedy)
    return number


def free_response(
    system: Callable[[ArrayLike], Floats],
    outputs: Callable[[ArrayLike], Floats],
    initial: Floats,
    *,
    period: float,
    n_periods: int,
    samples_per_period: int,
    start: float,
) -> Floats:
    """The outputs y(t₀ + kT + τ) = C(τ) Φ(τ, t₀) Φ(t₀ + T, t₀)^k x(t₀) (channels, samples).

    A(t) is integrated over one period only, so that the error after k periods is k times that of one: about 1e-13 k of
    the response there. `outputs` is C(t) -> (times, channels, n), `initial` the state at t₀ = `start`.
    """
    offsets = period * np.arange(samples_per_period + 1) / samples_per_period
    matrix = floquet.FunctionMatrix(function=system, period=period, vectorised=True)
    phi = floquet.transition(matrix, None, start + offsets, start=start)
    states = np.empty((n_periods, len(initial)))
    states[0] = initial
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(1, n_periods):
            states[k] = phi[-1] @ states[k - 1]
        observed = outputs(start + offsets[:-1]) @ phi[:-1]
        values = np.einsum("pcn,kn->ckp", observed, states, optimize=True)
    return values.reshape(values.shape[0], -1)
