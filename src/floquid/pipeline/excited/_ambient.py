"""The chain for outputs alone: excitation that goes on and that nobody measured, beside measured inputs or without."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.checks import Validation
from floquid.core import PeriodicModel, Provenance, Record
from floquid.errors import IdentificationError
from floquid.findings import Finding, Severity, failure, note, warning
from floquid.fit import DEVIATIONS, SURE
from floquid.innovations import (
    ALIKE,
    GONE,
    Fit,
    Predictor,
    alike,
    colour,
    first_innovations,
    gap_of,
    left_over,
    period_step,
    phase_step,
    predicted,
    repetition,
    searched,
    solve,
)
from floquid.inputs import Limits, Samples
from floquid.pipeline._analysis import AIM, Analysis
from floquid.pipeline._settings import Settings
from floquid.pipeline.excited._again import first_part, with_acting
from floquid.pipeline.excited._finish import HELD_OUT, finished, validation_of
from floquid.pipeline.excited._identify import HIGHEST
from floquid.pipeline.excited._prepare import COPY, OF, Parted, parted
from floquid.pipeline.excited._verdict import (
    SIGNIFICANT,
    done_beside,
    needed,
    no_mode,
    of_angle,
    of_outliers,
    of_period,
    of_phases,
    undriven,
)

PREDICTABLE = 0.03
"""The share of the variance of the innovations that is predictable from those before, from which on a model fails."""

CLEARLY = 2.0
"""The squared scores of the own period of a response over those of the one given, from which on it is told from it.

A response that is hardly periodic scores at many periods, by up to 1.6 times what it does at its own.
"""

SHORT = (0.5, 2.0)
"""Deviations of an exponent from the maximum of the likelihood, from which on that is told, and it is no estimate."""

TOGETHER = 3.0
"""Deviations of the decays of two modes within which they may be one."""

STILL = 10.0
"""Radians that a mode turns, and nepers that it decays, in a record, less than which it is likely a drift."""

NEAR_HALF = 0.25
"""The distance of a frequency from half the fundamental, over the decay, up to which a multiplier may be negative."""

SLIP = 0.3
"""Periods by which one may be off over a record, and its own be told to first order: no input has to meet its phase."""

VAGUE = 0.5
"""The relative deviation of the damping from which on a reader is warned."""


def identified_ambient(records: Sequence[Record], settings: Settings, report: Callable[[str], None]) -> Analysis:
    r"""Identify from the response to random excitation that nobody measured, of records with their clocks on.

    .. math:: z_{r,k+1} = e^{\lambda_r h} z_{r,k} + \kappa_r(t_k)\, e_k \;[+\; \beta_r(t_k)\, u_k], \qquad
              y_k = \sum_r \sum_m c_{r,m}\, e^{i m \omega t_k} z_{r,k} + e_k

    the innovations form, with e white: process noise and that of sensors together (Ljung 1999, section 4.3). First
    innovations are those of a long periodic autoregression (Hannan and Rissanen 1982); candidates for λ come from a
    subspace method with them as inputs, modes and harmonics are decided by tests, and all is finished by maximum
    likelihood. With `inputs` the same chain takes process noise and a closed loop into account.

    Raises InputError where the records, the inputs or the clock are not possible, IdentificationError where no mode
    rises above the noise.
    """
    if settings.inputs and settings.hold == "first":
        got = "is 'first'"
        remedy = "In discrete time an input acts from its sample to the next: use hold='zero', and sample faster."
        raise input_error("hold", OF, "be 'zero' or 'none' with random excitation", got, remedy)
    report("reading angle and channels")
    own = parted(records, settings, OF)
    samples, acting = with_acting(own)
    phases = 2.0 * np.pi / (samples.fundamental * samples.step)
    other, repeats = (0.0, ()) if own.shafts else _other_period(samples, trusted=settings.trust_period)
    highest = max(min(HIGHEST, int(0.5 * phases) - 1), 0) if settings.harmonics is None else settings.harmonics
    limits = Limits(
        mode_alarm=settings.mode_false_alarm,
        harmonic_alarm=settings.harmonic_false_alarm,
        highest=highest,
        seconds=settings.seconds,
    )
    report("taking first innovations from an autoregression")
    first = first_innovations(samples, acting)
    _refuse_copies(first, own)
    report("searching for modes")
    near, unfinished = searched(samples, first, limits, report)
    found = near.at
    late = (warning("out_of_time", seconds=settings.seconds),) if unfinished else ()
    if not found.modes:
        raise no_mode(samples, found, limits.mode_alarm, late)
    report("estimating deviations")
    fit = Fit(samples, found, acting)
    provenance = Provenance.merge(tuple(record.provenance for record in records))
    model = fit.model(own.outputs, own.inputs, provenance, near.as_read)
    validation, unpredicted = None, ()
    if settings.validate:
        report("predicting samples left out")
        validation, unpredicted = _validated(samples, found)
    assert model.exponent_std is not None
    duration = samples.n_samples * samples.step
    relative = model.exponent_std.real / np.abs(model.exponents.real)
    analysis = Analysis(
        settings=settings,
        records=own.records,
        model=model,
        driven=fit,
        shafts=own.shafts,
        validation=validation,
        findings=(
            *done_beside(own),
            *repeats,
            *undriven(model),
            needed(model, limits, [fit.seen(number) for number in range(len(found.modes))]),
            *_told(fit, model, relative, duration, near.as_read),
            *near.findings,
            *unpredicted,
            *_against(samples, found, other),
            # Blows that nobody measured are excitation, not faults.
            *(replace(told, severity=Severity.WARNING) for told in of_outliers(found.innovations, own)),
            *(() if own.shafts else of_period(samples, *period_step(fit), SLIP)),
            *of_angle(own, found.columns, np.sqrt(np.mean(found.innovations**2, axis=1))),
            *of_phases(samples, [phase_step(fit, number) for number in range(1, len(own.records))]),
            *([warning("inputs_modes", most=limits.modes)] if len(found.modes) >= limits.modes else []),
            *late,
        ),
    )
    return finished(analysis, own.periods_per_revolution, report)


def _refuse_copies(first: NDArray[np.float64], own: Parted) -> None:
    """Refuse outputs of which one is a sum of others: they have no innovations of their own."""
    spread = np.linalg.eigvalsh(np.corrcoef(first).reshape(len(first), -1))
    if spread[0] < COPY:
        names = ", ".join(repr(channel.name) for channel in own.outputs)
        raise IdentificationError(
            f"Of the outputs {names} one is a copy or a sum of others, without noise of its own: what each sample adds "
            "to those before is not independent. Leave it out: `channels=`."
        )


def _other_period(samples: Samples, *, trusted: bool) -> tuple[float, tuple[Finding, ...]]:
    """The frequency far from that given with which the response seems to repeat [rad/s], zero where none.

    One that is near, or half the period, is refused, and told where the period is `trusted`.
    """
    found, given = repetition(samples), 2.0 * np.pi / samples.fundamental
    told: tuple[Finding, ...] = ()
    if found.own > found.limit and found.own > CLEARLY * found.given and abs(found.shift) > found.resolution:
        scores = {"own_score": found.own, "given_score": found.given, "limit": found.limit}
        told = (failure("ambient_repeats", own=given * (1.0 + found.shift), given=given, **scores),)
    elif found.even > 2.0 * found.limit and found.odd < found.limit:
        told = (failure("ambient_twice", given=given, even=found.even, odd=found.odd, limit=found.limit),)
    if told and not trusted:
        raise IdentificationError(f"{told[0]} If you know the period to be right, pass `trust_period=True`.")
    return found.other, told


def _validated(samples: Samples, found: Predictor) -> tuple[Validation, tuple[Finding, ...]]:
    """The verdict from samples left out, and the finding that they are not predicted at all."""
    errors = _held_out(samples, found)
    if np.isinf(errors).any():
        return validation_of(errors, ()), (failure("ambient_unpredicted"),)
    against = [warning("ambient_held_out", error=float(errors.max()))] if (errors >= HELD_OUT).any() else []
    return validation_of(errors, against), ()


def _held_out(samples: Samples, found: Predictor) -> NDArray[np.float64]:
    """The rms of the innovations over that of the part fitted, on the last quarter of each record (outputs,)."""
    part, mask = first_part(samples)
    start = predicted(part, found.modes, found.columns, found.initial, found.whitening[mask])
    if start is None:
        return np.full(len(samples.values), np.inf)
    fitted = solve(part, start, rough=True)
    whole = predicted(samples, fitted.modes, fitted.columns, fitted.initial, growing=True)
    if whole is None:
        return np.full(len(samples.values), np.inf)
    expected = np.sqrt(np.mean(fitted.innovations**2, axis=1))
    return np.asarray(np.sqrt(np.mean(whole.innovations[:, ~mask] ** 2, axis=1)) / expected, np.float64)


def _told(
    fit: Fit, model: PeriodicModel, relative: NDArray[np.float64], duration: float, as_read: Collection[int]
) -> tuple[Finding, ...]:
    """Findings on the modes: how long a record their damping needs, which may be the excitation's, which nearly one.

    Whether a pair of one harmonic is two real multipliers does not matter: it is the excitation's own.
    """
    from scipy.special import chdtrc

    found, varying = [], []
    for number in range(len(fit.at.modes)):
        squares, degrees = fit.varying(number)
        varying.append(bool(degrees and chdtrc(degrees, squares) < SURE))
    if not any(varying):
        found.append(note("ambient_constant"))
    places = np.cumsum([0, *(mode.rows for mode in fit.at.modes)])[:-1]
    shares, hertz = relative[places], np.abs(model.exponents[places]) / (2.0 * np.pi)
    decays, own = np.abs(model.exponents[places].real), _own(fit)
    # Two that were read from one block are two, however near.
    groups = [
        np.array(group)
        for group in alike(fit.at.modes, model.fundamental)
        if len(set(group) - set(as_read)) > 0 and len(group) > 1
    ]
    found += _no_estimates(fit, model, shares, own, groups)
    longest = max(np.diff(fit.samples.begins)) * fit.samples.step
    still, low = ~own & (_away(fit) * longest < STILL), hertz * 2.0 * np.pi * longest < STILL
    for told, which in ((failure, still & low), (warning, still & ~low)):  # a line of the period may be a mode's
        if which.any():
            found.append(told("ambient_slow", frequencies=hertz[which].tolist()))
    several = len(fit.samples.records) > 1  # many short ones may tell a decay
    line = ~(own | still) & (decays * longest < 1.0) & ~(several & (shares < 1.0 / DEVIATIONS))
    if line.any():
        found.append(failure("ambient_line", frequencies=hertz[line].tolist()))
    no_axis = np.array([mode.axis == 0.0 for mode in fit.at.modes])
    single = ~(still | line.any()) & ~np.array(varying) & any(varying) & no_axis  # a line spoils what is said of others
    gone, real = decays * model.period > GONE, np.array([mode.real for mode in fit.at.modes])
    fast, lasts = gone & ~single & ~own, real & ~(gone | single | still | line | own)
    for code, which in (("ambient_single", single), ("ambient_fast", fast), ("ambient_real", lasts)):
        if which.any():
            found.append(warning(code, frequencies=hertz[which].tolist()))
    if (shares[~(still | line)] > AIM).any():
        worst = int(np.argmax(np.where(still | line, 0.0, shares)))
        told, periods = warning if shares[worst] > VAGUE else note, duration / model.period * (shares / AIM) ** 2
        found.append(
            told(
                "ambient_length",
                frequency=float(hertz[worst]),
                share=float(shares[worst]),
                periods=float(periods[worst]),
                seconds=float(periods[worst] * model.period),
            )
        )
    same = _not_apart(
        fit, shares * decays, (decays * model.period < GONE) & ~np.isin(range(len(decays)), list(as_read))
    )
    if groups or same:
        told = failure if same or any(_one(fit, model, group, shares) for group in groups) else warning
        found.append(told("ambient_alike", frequencies=hertz[np.unique(np.concatenate([*groups, *same]))].tolist()))
    return tuple(found)


def _no_estimates(
    fit: Fit,
    model: PeriodicModel,
    shares: NDArray[np.float64],
    own: NDArray[np.bool_],
    groups: Sequence[NDArray[np.int64]],
) -> list[Finding]:
    """Findings on modes of which the fit is no maximum, or the decay not determined.

    Of poles of the excitation that are nearly one no decay is claimed, which another finding says.
    """
    places = np.cumsum([0, *(mode.rows for mode in fit.at.modes)])[:-1]
    nepers, hertz = np.abs(model.exponents[places].real) * model.period, np.abs(model.exponents[places]) / (2.0 * np.pi)
    grouped = np.isin(np.arange(len(nepers)), np.concatenate([*groups, []]))
    claimed = ~(grouped & (nepers > GONE) & ~own)
    short, dead = np.array([fit.short(number) for number in range(len(nepers))]), (shares * nepers > 1.0) & claimed
    found = [failure("ambient_undetermined", frequencies=hertz[dead].tolist())] if dead.any() else []
    which = claimed & (short > SHORT[0])
    if which.any():
        told, most = failure if short[which].max() > SHORT[1] else warning, float(short[which].max())
        found.append(told("ambient_short", frequencies=hertz[which].tolist(), deviations=most))
    return found


def _away(fit: Fit) -> NDArray[np.float64]:
    """The distance of each exponent from the multiples of iω, where an offset and what repeats is (modes,) [1/s]."""
    omega = fit.samples.fundamental
    rates = np.array([complex(own.exponent.real, own.exponent.imag + own.axis * omega) for own in fit.at.modes])
    return np.abs(rates - 1j * omega * np.rint(rates.imag / omega))


def _own(fit: Fit) -> NDArray[np.bool_]:
    """True of modes that are the system's: driven by a measured input, or with a negative multiplier (modes,).

    Coloured excitation is driven by none, and what decays in it without turning has a positive one.
    """
    from scipy.special import chdtrc

    found, omega = [], fit.samples.fundamental
    for number, (mode, place) in enumerate(zip(fit.at.modes, fit.places, strict=True)):
        squares, degrees = fit.reached(number)
        halves = 2.0 * (mode.axis + mode.exponent.imag / omega)
        away, std = 0.5 * omega * abs(halves - round(halves)), fit.parameters[(place.start + mode.rows - 1,) * 2] ** 0.5
        negative = round(halves) % 2 == 1 and away <= min(SIGNIFICANT * std, NEAR_HALF * abs(mode.exponent.real))
        found.append(negative or bool(degrees and chdtrc(degrees, squares) < SURE))
    return np.array(found)


def _not_apart(fit: Fit, std: NDArray[np.float64], lasting: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Twos of modes that outlast a period, and of which the deviations (modes,) do not tell that they are two."""
    modes, omega = fit.at.modes, fit.samples.fundamental
    return [
        np.array([one, other])
        for one, other in combinations(np.flatnonzero(lasting).tolist(), 2)
        if gap_of(modes[one], modes[other], omega)[0] < TOGETHER * float(np.hypot(std[one], std[other]))
    ]


def _one(fit: Fit, model: PeriodicModel, group: NDArray[np.int64], shares: NDArray[np.float64]) -> bool:
    """True where modes that outlast a period are nearer to each other than their deviations tell: a copy may be false.

    Poles of excitation that die within a period often are the same and are there.
    """
    modes = [fit.at.modes[number] for number in group]
    lasting = any(-mode.exponent.real * model.period < GONE for mode in modes)
    near = min(SIGNIFICANT * float(shares[group].max()), ALIKE)
    return lasting and len(alike(modes, model.fundamental, near)) < len(modes)


def _against(samples: Samples, found: Predictor, other: float) -> tuple[Finding, ...]:
    """Findings against the model: colour in its innovations, and what repeats otherwise.

    Lines of a narrow band alone pass for a period of the response, and are none where the model takes account of them.
    """
    against = []
    share, chance = colour(samples, found)
    if chance < SURE:
        told = failure if share > PREDICTABLE else warning
        against.append(told("ambient_colour", share=share))
    if other and left_over(samples, found.innovations, other):
        against.append(failure("ambient_period", own=2.0 * np.pi / other, given=2.0 * np.pi / samples.fundamental))
    return tuple(against)
