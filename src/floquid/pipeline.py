"""The whole chain: records → poles → periodic model → state matrix, with every intermediate kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error, integer, positive
from floquid.core import ConstantPeriod, Cycles, PeriodicModel, Provenance, Record, channels_named
from floquid.errors import IdentificationError
from floquid.lifting import Lifted, lift
from floquid.lti import MaximumLikelihood, ModalModel, Outcome
from floquid.periodic import assemble, synchrony
from floquid.reconstruction import StateModel, reconstruct
from floquid.sync import segment

CONFIDENT = 2e-3
"""A mode counts as well determined when both parts of its exponent have a deviation below this share of ω."""

ENOUGH_CYCLES = 3
"""Cycles a pole that a hit must hold for its noise to be judged by itself."""

NOISE_ROUNDS = 4
"""How often the noise may be estimated again from the residual."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Every option of `identify`.

    Parameters
    ----------
    period
        The period [s]; None takes that of each record's clock.
    channels
        Names of the channels to use; empty for all.
    order
        The number of complex poles, conjugates one by one; None finds it.
    harmonics
        Keep the harmonics -harmonics … harmonics of each mode; None keeps those that rise above the noise.
    states
        Names of the channels that are the displacement states of A(t); empty to leave A(t) out.
    system_times
        The number of instants of a period at which A(t) is given.
    mode_false_alarm
        The probability at which noise may pass for a mode.
    harmonic_false_alarm
        The probability at which noise may pass for a harmonic.
    noise_floor
        The least share of a channel's largest value that the noise is taken to be: the level down to which the record
        can be believed.
    trust_period
        Warn instead of refusing when the response seems to repeat with another period than the one given.

    Raises
    ------
    InputError
        A value is not possible.
    """

    period: float | None = None
    channels: tuple[str, ...] = ()
    order: int | None = None
    harmonics: int | None = None
    states: tuple[str, ...] = ()
    system_times: int = 50
    mode_false_alarm: float = 1e-9
    harmonic_false_alarm: float = 1e-8
    noise_floor: float = 1e-10
    trust_period: bool = False

    def __post_init__(self) -> None:
        of = "Settings"
        if self.period is not None:
            object.__setattr__(self, "period", positive(self.period, "period", of, unit="s"))
        for name in ("channels", "states"):
            value = getattr(self, name)
            listed = isinstance(value, (tuple, list))
            if not listed or not all(isinstance(entry, str) for entry in value):
                raise input_error(name, of, "be a list of channel names", f"is {value!r}", 'Pass e.g. ["x", "y"].')
            object.__setattr__(self, name, tuple(value))
        if self.order is not None:
            integer(self.order, "order", of, at_least=1)
        if self.harmonics is not None:
            integer(self.harmonics, "harmonics", of, at_least=0)
        integer(self.system_times, "system_times", of, at_least=1)
        if not isinstance(self.trust_period, (bool, np.bool_)):
            raise input_error("trust_period", of, "be true or false", f"is {self.trust_period!r}")
        object.__setattr__(self, "trust_period", bool(self.trust_period))
        for name in ("mode_false_alarm", "harmonic_false_alarm", "noise_floor"):
            if not 0.0 < positive(getattr(self, name), name, of) < 1.0:
                raise input_error(name, of, "lie between 0 and 1", f"is {getattr(self, name)}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Analysis:
    """What `identify` found, with every intermediate.

    Parameters
    ----------
    settings
        The options used.
    records, cycles, lifted, modal
        The stages: records as used, cut into periods, lifted, and the modal model of the lifted responses.
    model
        The periodic model: exponents and shapes.
    state
        Φ and A(t), when states were asked for.
    warnings
        What a reader of the result must know.
    """

    settings: Settings
    records: tuple[Record, ...]
    cycles: tuple[Cycles, ...]
    lifted: Lifted
    modal: ModalModel
    model: PeriodicModel
    state: StateModel | None = None
    warnings: tuple[str, ...] = field(default=())

    @property
    def provenance(self) -> Provenance:
        """Where the result comes from."""
        return self.model.provenance


def identify(
    records: Record | Sequence[Record],
    settings: Settings | None = None,
    *,
    report: Callable[[str], None] = lambda _: None,
    **options: object,
) -> Analysis:
    """Identify a linear time-periodic system from its free response.

    Cut into periods, lift (eqs. 7-10), find the poles by maximum likelihood with the order tested, take off the delay,
    expand in harmonics (eqs. 4-12), and, when `states` are named, rebuild A(t) (eqs. 13-21 of Allen 2009, as
    corrected).

    Parameters
    ----------
    records
        One record, or one a hit on the same system.
    settings
        The options; or give them by name.
    report
        Is told what is being done, a phrase a stage.
    **options
        Fields of `Settings`.

    Returns
    -------
    Analysis
        The result and every intermediate.

    Raises
    ------
    InputError
        A record or an option is not possible.
    IdentificationError
        No mode rises above the noise, the record is too short, or the result would look right and be wrong.
    """
    chosen = _settings(settings, options)
    used = _prepare(records, chosen)
    report("cutting into periods")
    cycles = segment(used)
    _refuse_impossible(chosen, cycles)
    _refuse_copies(used)
    report("estimating the noise")
    lifted = lift(cycles, floor=chosen.noise_floor)
    lifted, modal = _find_poles(lifted, chosen, report)
    report("expanding the shapes in harmonics")
    model = assemble(modal, lifted, false_alarm=chosen.harmonic_false_alarm, harmonics=chosen.harmonics)
    doubt = _wrong_period(model, lifted)
    if doubt and not chosen.trust_period:
        raise IdentificationError(
            f"{doubt}\n  Correct the period; if it is no whole number of samples, resample the record. If you know the "
            "period to be right, pass `trust_period=True` (`--trust-period`)."
        )
    state = None
    if chosen.states:
        report("rebuilding the state matrix")
        state = reconstruct(model, chosen.states, times=chosen.system_times)
    return Analysis(
        settings=chosen,
        records=used,
        cycles=cycles,
        lifted=lifted,
        modal=modal,
        model=model,
        state=state,
        warnings=((doubt,) if doubt else ()) + _warnings(model),
    )


def _settings(settings: Settings | None, options: dict[str, object]) -> Settings:
    from dataclasses import fields, replace

    known = [f.name for f in fields(Settings)]
    for name in options:
        if name not in known:
            raise input_error(
                name,
                "identify",
                "be a field of Settings",
                "there is none of that name",
                f"The fields are: {', '.join(known)}.",
            )
    return replace(settings or Settings(), **options)  # type: ignore[arg-type]


def _prepare(records: Record | Sequence[Record], settings: Settings) -> tuple[Record, ...]:
    """The records with the channels and the clock of the settings."""
    several = (records,) if isinstance(records, Record) else tuple(records)
    if not several or not all(isinstance(r, Record) for r in several):
        raise input_error(
            "records", "identify", "be a Record or a list of them", f"is {records!r:.60}", "Read files with `read`."
        )
    used = []
    for record in several:
        if settings.channels:
            record = record.select(settings.channels)
        if settings.period is not None:
            origin = record.clock.origin if record.clock else 0.0
            record = record.with_clock(ConstantPeriod(period=settings.period, origin=origin))
        used.append(record)
    return tuple(used)


def _refuse_impossible(settings: Settings, cycles: Sequence[Cycles]) -> None:
    """Refuse what cannot end well before any long work."""
    of, periods, phases = "identify", max(c.n_cycles for c in cycles), cycles[0].n_phases
    shortest = min(c.n_cycles for c in cycles)
    if shortest < 4:
        raise IdentificationError(
            f"The record holds {shortest} whole period{'s' if shortest > 1 else ''}: fewer than 4 cannot hold a mode "
            "and the noise beside it. Record longer, or check the period."
        )
    channels_named(cycles[0].channels, settings.states, argument="states", of=of)
    if settings.order is not None and settings.order >= periods:
        got = f"is {settings.order}"
        raise input_error("order", of, f"be less than the {periods} periods of the record", got, "Ask for fewer poles.")
    if settings.harmonics is not None and 2 * settings.harmonics >= phases:
        must = f"be less than half the {phases} samples a period"
        raise input_error("harmonics", of, must, f"is {settings.harmonics}", "Ask for fewer, or sample faster.")


def _refuse_copies(records: Sequence[Record]) -> None:
    """Refuse a channel or a hit that is a copy of another: its noise would count as independent of the other's."""
    seen: dict[bytes, str] = {}
    for hit, record in enumerate(records, start=1):
        for channel, values in zip(record.channels, record.values, strict=True):
            name = f"channel {channel.name!r}" + (f" of record {hit}" if len(records) > 1 else "")
            found = seen.setdefault(sha256(values.tobytes()).digest(), name)
            if found != name and np.ptp(values) > 0.0:
                raise input_error(
                    "records",
                    "identify",
                    "be independent measurements",
                    f"{name} is a copy of {found}, sample by sample",
                    "Leave one of them out: a copy adds no knowledge, but would make the deviations too small.",
                )


def _find_poles(lifted: Lifted, settings: Settings, report: Callable[[str], None]) -> tuple[Lifted, ModalModel]:
    """Poles and noise together: the noise is taken again from the residual until it stays."""
    identifier = MaximumLikelihood(false_alarm=settings.mode_false_alarm)
    modal: ModalModel | None = None
    for round_ in range(NOISE_ROUNDS):
        state = identifier.prepare(lifted.responses)
        if modal is None:
            report("searching for modes")
            modal = identifier.extract(
                state, settings.order, report=lambda text: report(f"searching for modes: {text}")
            )
        else:
            modal = identifier.refine(state, modal)
        if modal.outcome is not Outcome.SUCCESS:
            words = modal.outcome.value
            if modal.outcome is Outcome.ORDER_UNREACHED:
                words = (
                    f"order {settings.order} cannot be reached, the nearest found is {modal.order}: the data hold no "
                    "more, or a conjugate pair, which counts as two, would have to be halved. Ask for that order, or "
                    "let it be found."
                )
            raise IdentificationError(f"Identification ended without a result: {words}")
        noise = _noise_left(lifted, modal)
        again = lifted.with_noise(noise)
        change = np.abs(np.log(again.noise / lifted.noise)).max()
        lifted = again
        if change < 1e-3 and round_:
            break
        if change > 0.1:
            modal = None
    if modal is None:
        raise IdentificationError(
            "Identification ended without a result: the noise cannot be told from the response, its estimate does not "
            "settle as modes are fitted. Look at the record: are its samples clipped, or rounded to a few levels?"
        )
    return lifted, modal


def _noise_left(lifted: Lifted, modal: ModalModel) -> NDArray[np.float64]:
    """The noise in what the fit leaves (channels, hits).

    A hit with hardly more cycles than there are poles leaves nothing to judge its noise by, and would be weighted by
    chance: beside longer ones it is refused.
    """
    assert modal.residual_std is not None
    lengths = lifted.responses.lengths
    long = lengths >= ENOUGH_CYCLES * modal.order
    if long.any() and not long.all():
        short = int(np.argmin(lengths))
        raise IdentificationError(
            f"Hit {short + 1} holds {lengths[short]} whole periods, fewer than {ENOUGH_CYCLES} for each of the "
            f"{modal.order} poles found: its noise cannot be judged beside that of the longer hits. Leave it out."
        )
    return np.sqrt(np.mean(lifted.by_channel(modal.residual_std**2), axis=1))


def _wrong_period(model: PeriodicModel, lifted: Lifted) -> str:
    """What is wrong with a period other than that of the response; empty when nothing is."""
    found = synchrony(model, lifted)
    if found is None or not found.broken:
        return ""
    own = model.period * (1.0 + found.relative)
    return (
        f"The response does not repeat with the period given: its own is {own:.10g} ± "
        f"{model.period * found.std:.1g} s, not {model.period:.10g} s; over the record the phase slips by "
        f"{found.slip:.3g} samples. Exponents and shapes would look right and be wrong."
    )


def _halved(model: PeriodicModel, std: NDArray[np.complex128]) -> bool:
    """Whether half of the modes have a partner of equal decay at an odd number of half fundamentals."""
    gap = model.exponents[:, None] - model.exponents[None, :]
    deviation = np.hypot(std.real[:, None], std.real[None, :]), np.hypot(std.imag[:, None], std.imag[None, :])
    halves = 2.0 * gap.imag / model.fundamental
    odd = 2.0 * np.rint((halves - 1.0) / 2.0) + 1.0
    apart = np.abs(halves - odd) * model.fundamental < 10.0 * deviation[1]
    apart &= deviation[1] < 1e-3 * model.fundamental
    alike = (np.abs(gap.real) < 5.0 * deviation[0]) & (deviation[0] < 0.1 * np.abs(model.exponents.real))
    # A mode and its own conjugate are no two modes.
    itself = np.abs(model.exponents[:, None] - model.exponents[None, :].conj()) == 0
    return bool(2 * (apart & alike & ~itself).any(axis=1).sum() >= max(model.order, 1))


def _warnings(model: PeriodicModel) -> tuple[str, ...]:
    """What a reader of the result must know."""
    words = []
    std = model.exponent_std
    if std is not None:
        weak = np.maximum(std.real, std.imag) > CONFIDENT * model.fundamental
        count = int(weak.sum())
        if count:
            words.append(
                f"{count} of {model.order} exponents are weakly determined (deviation above {CONFIDENT:g} of the "
                "fundamental): each may stand for several modes that this record cannot tell apart."
            )
        still = np.abs(np.angle(model.multipliers)) < 3.0 * std.imag * model.period + 1e-12
        still &= np.maximum(std.real, std.imag) < CONFIDENT * model.fundamental
        still &= np.abs(model.exponents.real) < 4.0 * std.real + 1e-9 * model.fundamental
        if still.any():
            words.append(
                "A component with a multiplier of 1 neither grows nor decays: it is most likely the forced periodic "
                "response (imbalance, an offset), not a mode."
            )
    if model.order and not ((np.abs(model.coefficients).max(axis=(1, 2)) > 0).sum(axis=1) > 1).any():
        words.append(
            "No mode has a second harmonic above the noise: the system looks constant, or the period is wrong and tore "
            "each harmonic into a mode of its own."
        )
    if std is not None and _halved(model, std):
        words.append(
            "Modes come in pairs of equal decay, half a fundamental apart: the true period is most likely twice the "
            "one given, and each mode is listed twice."
        )
    growing = model.exponents.real > (4.0 * std.real if std is not None else 0.0)
    if growing.any():
        words.append(
            f"{int(growing.sum())} of {model.order} exponents grow: the system is unstable, or it is being driven."
        )
    return tuple(words)
