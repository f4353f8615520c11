"""The angle of the shaft against time, from pulses or from an azimuth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats, Integers, Mask
from floquid._checks import Sealed, frozen_array, input_error
from floquid.core import PhaseClock, Record
from floquid.findings import Finding, note, texts, warning
from floquid.fit import DEVIATIONS, HALF_DIGITS, SURE, chi2_limit
from floquid.sync._angle_spline import AngleFit, AngleSpline, fit_angle
from floquid.sync._read_clock import OF, Evidence, evidence

STEADY, USABLE = 0.01, 0.05
"""Wander of the speed, of its mean: below the one a periodic model holds, beyond the other it does not."""

GAP = 2.5
"""Revolutions without a pulse, also before the first and after the last, that are told of: two are one pulse missed.
The deviation of the angle does not hold how the speed changed there."""
ALIKE = 0.4  # correlation of neighbours in what is left over that is told of
APART = 2.0  # revolutions between knots at least: less, and uneven lines would be taken for a change of speed


def speed_verdict(wander: float, run: float, mean_speed: float) -> tuple[bool, Finding]:
    """True where the speed is steady enough, with the finding: from its relative wander and change over the record."""
    hz, percent = mean_speed / (2.0 * np.pi), 100.0 * wander
    if abs(run) > USABLE:
        return False, note("speed_runs", percent=100.0 * run, hz=hz)
    if wander > USABLE:
        return False, note("speed_wanders", percent=percent, hz=hz, limit=100.0 * USABLE)
    if wander > STEADY:
        return True, note("speed_usable", percent=percent, hz=hz, limit=100.0 * STEADY)
    return True, note("speed_steady", percent=percent, hz=hz) if wander > 0.0 else note("speed_constant", hz=hz)


def repairs(
    missing: int, doubled: int, rejected: int, used: int, what: str, absent: tuple[int, ...], lines: int
) -> list[Finding]:
    """Findings on pulses that were missing, doubled or rejected."""
    said = [note("absent_lines", absent=absent, lines=lines)] if absent else []
    if missing:
        said.append(note("pulses_missing", number=missing, used=used, what=what))
    wrong = {"pulses_doubled": doubled, "pulses_rejected": rejected}
    return said + [note(code, number=number, what=what) for code, number in wrong.items() if number]


def uneven(offsets: Floats, offsets_std: Floats) -> list[Finding]:
    """Finding on lines that are unevenly spaced beyond what chance explains."""
    known = np.isfinite(offsets) & (offsets_std > 0.0)
    n = int(known.sum())
    if n < 2:
        return []
    if np.sum((offsets[known] / offsets_std[known]) ** 2) < chi2_limit(n - 1, SURE):
        return []
    worst = float(np.degrees(np.abs(offsets[known]).max()))
    return [note("uneven_lines", lines=n, degrees=worst, percent=100.0 * worst / (360.0 / len(offsets)))]


def gaps(times: Floats, mean_speed: float) -> list[Finding]:
    """Finding on stretches without evidence."""
    turns = np.diff(times) * mean_speed / (2.0 * np.pi)
    wide = np.flatnonzero(turns > max(GAP, 3.0 * float(np.median(turns))))
    if len(wide) == 0:
        return []
    worst = wide[np.argmax(turns[wide])]
    first, last = times[worst : worst + 2]
    return [warning("angle_bridged", first=first, last=last, revolutions=turns[worst], more=len(wide) - 1)]


def alike(residuals: Floats) -> list[Finding]:
    """Finding on residuals that follow one another: a random error differs from pulse to pulse."""
    power = float(residuals @ residuals)
    correlation = float(residuals[1:] @ residuals[:-1]) / power if power > 0.0 else 0.0
    if correlation < max(ALIKE, DEVIATIONS / np.sqrt(len(residuals))):
        return []
    return [warning("angle_alike", correlation=correlation)]


def outside(before: float, after: float) -> list[Finding]:
    """Finding on a record that goes beyond the evidence, in revolutions."""
    before, after = (many if many > GAP else 0.0 for many in (before, after))
    return [note("beyond_angle", before=before, after=after)] if before or after else []


TURN = 2.0 * np.pi


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ShaftAngle(Sealed):
    r"""The angle of the shaft over time with its uncertainty, and what may be said of the speed.

    .. math:: \theta(t) = \sum_j c_j B_j(t), \qquad \theta(t_k) = 2 \pi n_k / L + g_{n_k \bmod L} - g_0 + \epsilon_k

    Parameters
    ----------
    spline
        The angle over the evidence, straight beyond it; one straight line where the speed is constant.
    periods_per_revolution
        Periods of the system in a revolution.
    times, residuals, lines
        Of each pulse that was counted, or block of samples of an azimuth: its time (pulses,) [s], the angle that it
        shows less the angle of the fit (pulses,) [rad], and the line that it is (pulses,).
    kept
        Those that were not rejected (pulses,).
    jitter, jitter_unit
        The standard deviation of what is left over, and its unit: of pulses their times, "s", of an azimuth the angle
        averaged over an eighth of a revolution, "rad".
    geometry, geometry_std
        How far each line of the encoder is ahead of even spacing (lines,) [rad], and its standard deviation; NaN for
        lines that never gave a pulse. None where that is not estimated: one line, or less than three revolutions.
    n_pulses, missing, doubled, rejected
        Pulses (of an azimuth: samples) that were used; that should have come and did not; left out as one too many in
        its place; left out as outliers.
    wander, steady, findings
        The rms of the speed about its mean, over the mean; true where that is constant enough for a periodic model; and
        why, with numbers, and what was repaired.
    rounded
        The most that a pulse is off [s], where each is known to a sample only; zero elsewhere.
    """

    measured = True
    fitted = False

    spline: AngleSpline
    periods_per_revolution: float
    times: Floats
    residuals: Floats
    lines: Integers
    kept: Mask
    jitter: float
    jitter_unit: Literal["s", "rad"]
    geometry: Floats | None
    geometry_std: Floats | None
    n_pulses: int
    missing: int
    doubled: int
    rejected: int
    wander: float
    steady: bool
    findings: tuple[Finding, ...]
    rounded: float = 0.0

    @property
    def reasons(self) -> tuple[str, ...]:
        """Steadiness of the speed and repairs of the pulses, a sentence each."""
        return texts(self.findings)

    @property
    def first(self) -> float:
        """Begin of the evidence [s]."""
        return self.spline.first

    @property
    def last(self) -> float:
        """End of the evidence [s]."""
        return self.spline.last

    @property
    def coarse(self) -> bool:
        """True where the speed is steady within what pulses show that are known to a sample only."""
        return self.rounded > 0.0 and self.spline.degree == 1

    @property
    def mean_speed(self) -> float:
        """The mean speed over the evidence [rad/s]."""
        return self.spline.mean_speed()[0]

    @property
    def period(self) -> float:
        """The mean period of the system [s]: 2π over the mean speed and the periods per revolution."""
        return TURN / (self.mean_speed * self.periods_per_revolution)

    @property
    def period_std(self) -> float:
        """The standard deviation of the mean period [s]."""
        speed, std = self.spline.mean_speed()
        return self.period * std / speed

    def angle(self, times: ArrayLike) -> Floats:
        """The angle [rad] at `times` [s], unwrapped: zero at a pulse of line 0, or where the azimuth is."""
        return self._at(self.spline.angle, times, "angle")

    def angle_std(self, times: ArrayLike) -> Floats:
        """The standard deviation of the angle [rad] at `times` [s]."""
        return self._at(self.spline.angle_std, times, "angle_std")

    def speed(self, times: ArrayLike) -> Floats:
        """The speed [rad/s] at `times` [s]."""
        return self._at(self.spline.speed, times, "speed")

    def speed_std(self, times: ArrayLike) -> Floats:
        """The standard deviation of the speed [rad/s] at `times` [s]."""
        return self._at(self.spline.speed_std, times, "speed_std")

    def turns(self, times: Floats) -> Floats:
        """Periods from phase zero to `times` [s]."""
        return self.angle(times) * self.periods_per_revolution / TURN

    def times_at(self, turns: Floats) -> Floats:
        """The times [s] at which these periods, `turns`, have passed since phase zero."""
        return self.time_at(TURN * turns / self.periods_per_revolution)

    def phase(self, time: float) -> float:
        """The phase at `time` [s], as a fraction of a period in [0, 1)."""
        turns = float(self.turns(np.array([time]))[0])
        return max(turns - np.floor(turns + HALF_DIGITS), 0.0)

    def phase_zero(self, time: float) -> float:
        """The last instant of phase zero [s] up to `time` [s]."""
        return float(self.times_at(np.floor(self.turns(np.array([time])) + HALF_DIGITS))[0])

    def since_phase_zero(self, start: float, ticks: Floats) -> tuple[Floats, Floats]:
        """Times [s] and angles [rad] since the last phase zero up to `start` [s], at `ticks` [s] after it."""
        times = start + ticks
        angles = self.angle(times) * self.periods_per_revolution
        return times - self.phase_zero(start), angles - TURN * np.floor(angles[0] / TURN + HALF_DIGITS)

    def fluctuation(self, times: Floats) -> Floats:
        """Relative deviation of the speed at `times` [s] from its mean."""
        return self.speed(times) / self.mean_speed - 1.0

    def angle_spread(self, times: Floats) -> float:
        """The standard deviation of the angle, rms over `times` [s] within the evidence, [rad]."""
        return float(np.sqrt(np.mean(self.angle_std(np.clip(times, self.first, self.last)) ** 2)))

    def time_at(self, angle: ArrayLike) -> Floats:
        """Time [s] at which the shaft comes to each `angle` [rad], by Newton's method.

        Raises InputError where an angle is not finite.
        """
        return self._at(self._times_at, angle, "time_at", argument="angle")

    def _times_at(self, angles: Floats) -> Floats:
        grid = np.linspace(self.first, self.last, 8 * len(self.spline.knots))
        known = self.spline.angle(grid)
        times = np.interp(angles, known, grid)
        for _ in range(50):
            step = (angles - self.spline.angle(times)) / self.spline.speed(times)
            times += step
            if not step.size or np.abs(step).max() <= 4.0 * np.spacing(np.abs(times).max()):
                break
        return times

    @staticmethod
    def _at(function: Callable[[Floats], Floats], values: ArrayLike, method: str, argument: str = "times") -> Floats:
        shape = np.shape(values)
        flat = frozen_array(np.ravel(values), argument, f"ShaftAngle.{method}", axes=(argument,))
        return function(flat).reshape(shape)


def tied(record: Record) -> PhaseClock:
    """Clock of the `record` where it says the phase, else the angle of the shaft that it shows (`shaft_angle`)."""
    return record.clock if isinstance(record.clock, PhaseClock) else shaft_angle(record)


def shaft_angle(record: Record) -> ShaftAngle:
    r"""The angle of the shaft by the record's clock: a tachometer, an azimuth, or times of pulses.

    .. math:: \min_{c, g} \sum_k \Bigl(2 \pi n_k / L - \sum_j c_j B_j(t_k) + g_{n_k \bmod L}\Bigr)^2

    One linear least squares for a cubic B-spline and the offsets of the L lines. The number of pieces is the one that
    Akaike's criterion prefers; a straight line, unless noise alone makes it so much worse once in a million.
    Pulses beyond five robust deviations are left out. Of edges that are known to a sample only, as of a logic level
    once a revolution, the line is straight where one is within the rounding of each.

    The clock of the `record` is a `TachometerSignal`, an `AzimuthSignal` or `PulseTimes`. Raises InputError where the
    clock is another, or its channel is not in the record or holds no pulses or no angle. So it does where fewer than
    three pulses remain, or the shaft stands still or turns back.
    """
    seen = evidence(record.clock, record)
    revolutions = float(seen.angles[-1] - seen.angles[0]) / TURN
    most = max(int(revolutions / APART), 1)
    fit = fit_angle(seen.times, seen.angles, seen.lines, seen.n_lines, most, step=seen.step, rounded=seen.rounded)
    spline = fit.spline
    speeds = spline.speed(np.linspace(spline.first, spline.last, 8 * len(spline.knots)))
    mean = spline.mean_speed()[0]
    if speeds.min() <= 0.0:
        must = "be of a shaft that turns one way throughout"
        got = f"its speed goes from {speeds.min() / TURN:.3g} to {speeds.max() / TURN:.3g} Hz"
        raise input_error("record", OF, must, got, "Cut the record to a part in which the shaft turns.")
    wander = float(np.sqrt(np.mean((speeds / mean - 1.0) ** 2))) if spline.degree > 1 else 0.0
    steady, why = speed_verdict(wander, float(speeds[-1] - speeds[0]) / mean, mean)
    n_used = int(np.count_nonzero(fit.kept)) * seen.each
    rejected = seen.rejected + int(np.count_nonzero(~fit.kept)) * seen.each
    return ShaftAngle(
        spline=spline,
        periods_per_revolution=seen.periods_per_revolution,
        times=seen.times,
        residuals=fit.residuals,
        lines=seen.lines,
        kept=fit.kept,
        jitter=fit.std / mean if seen.unit == "s" else fit.std,
        jitter_unit=seen.unit,
        geometry=-fit.offsets if seen.n_lines > 1 else None,
        geometry_std=fit.offsets_std if seen.n_lines > 1 else None,
        n_pulses=n_used,
        missing=seen.missing,
        doubled=seen.doubled,
        rejected=rejected,
        rounded=seen.rounded,
        wander=wander,
        steady=steady,
        findings=(why, *_remarks(record, seen, fit, n_used, rejected)),
    )


def _remarks(record: Record, seen: Evidence, fit: AngleFit, n_used: int, rejected: int) -> list[Finding]:
    """Findings on repairs, and on what has to be taken on trust."""
    spline = fit.spline
    fixed = repairs(seen.missing, seen.doubled, rejected, n_used, seen.what, seen.absent, seen.n_lines)
    said = [*seen.said, *fixed, *gaps(seen.times[fit.kept], spline.mean_speed()[0])]
    if seen.n_lines > 1:
        said += uneven(fit.offsets, fit.offsets_std)
    if fit.std > STEADY * TURN:
        said.append(warning("rough_angle", degrees=np.degrees(fit.std)))
    if not seen.rounded or spline.degree > 1:  # rounding makes a pattern of its own
        said += alike(fit.residuals[fit.kept])
    ends = spline.speed(np.array([spline.first, spline.last])) / TURN
    stop = record.start + (record.n_samples - 1) / record.sample_rate
    return said + outside(float(ends[0]) * (spline.first - record.start), float(ends[1]) * (stop - spline.last))
