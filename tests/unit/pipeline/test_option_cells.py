"""Options × kinds of records: each option changes what is made of a record, or is refused with its reason."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from tests.driven import ambient_of, mathieu, record_of, two_masses

from floquid import Channel, ConstantPeriod, InputError, Record, Settings, identify
from floquid.errors import FloquidError
from floquid.pipeline._deviations import state_of
from floquid.pipeline.free import again_of
from floquid.preparation import FORBIDDEN, WORDS, prepare
from floquid.systems import JeffcottRotor

KINDS = {"free": {}, "inputs": {"inputs": ["F"]}, "ambient": {"excitation": "ambient"}}
SYSTEM, ROTOR, PHASES = mathieu(), JeffcottRotor(), 16
BOTH = two_masses()
MASSES = replace(BOTH, B=lambda t: BOTH.B(t)[:, :1])


@cache
def record(kind, which="plain"):
    """A record of a kind: two outputs, pulses and the angle of a shaft, and the force that was measured."""
    several = which == "several"
    if kind == "free":
        found = ROTOR.simulate(n_periods=36, samples_per_period=PHASES, noise=0.01, seed=1)
        values, inputs, period = found.values, found.values[:0], ROTOR.period
    elif kind == "inputs":
        values, inputs = record_of(MASSES if several else SYSTEM, 25, PHASES, 0.05, 0)
        period = SYSTEM.period
    else:
        values, inputs = ambient_of(MASSES if several else SYSTEM, 160, PHASES, 0.02, 0), np.zeros((0, 160 * PHASES))
        period = SYSTEM.period
    period = MASSES.period if several and kind != "free" else period
    if len(values) == 1:
        values = np.concatenate([values, 0.5 * values + 0.02 * np.random.default_rng(3).standard_normal(values.shape)])
    turned = np.arange(values.shape[1]) / PHASES
    rows = [*values, turned % 1.0 < 0.3, 360.0 * turned, *inputs]
    names = [f"x{number}" for number in range(len(values))]
    channels = [Channel(name=name, unit="m", quantity="displacement") for name in names]
    channels += [Channel(name="pulses", quantity="pulse"), Channel(name="angle", unit="deg", quantity="angle")]
    channels += [Channel(name=name, unit="N", quantity="force") for name in ("F",)[: len(inputs)]]
    made = Record(values=np.array(rows, float), sample_rate=PHASES / period, channels=channels)
    return MAKES[which](made, period)


def clocked(made, period):
    return made.with_clock(ConstantPeriod(period=period))


def with_orbit(made, period):
    orbit = np.zeros((made.n_channels, PHASES))
    orbit[0] = np.cos(2.0 * np.pi * np.arange(PHASES) / PHASES)
    return replace(clocked(made, period), orbit=orbit)


def that_stands_still(made, period):
    values = np.array(made.values)
    values[0, 200:230] = 0.0
    return replace(clocked(made, period), values=values)


def faint(made, period):
    rows = np.array([channel.quantity == "displacement" for channel in made.channels])[:, None]
    noise = np.random.default_rng(7).standard_normal(made.values.shape) * made.values.std(axis=1, keepdims=True)
    return replace(clocked(made, period), values=made.values + 1.5 * rows * noise)


def struck_twice(made, period):
    again = 0.9 * made.values + 1e-3 * np.random.default_rng(5).standard_normal(made.values.shape)
    return replace(clocked(made, period), values=np.concatenate([made.values, again], axis=1))


MAKES = {
    "plain": clocked, "several": clocked, "bare": lambda made, _: made, "orbit": with_orbit, "fault": that_stands_still,
    "twice": struck_twice, "faint": faint, "wrong": lambda made, period: clocked(made, 1.02 * period),
}  # fmt: skip

PREPARED = {
    "period": ("plain", {}, 1.5),
    "channels": ("plain", {}, ["x0"]),
    "hold": ("plain", {}, "first"),
    "estimate_period": ("plain", {}, True),
    "tach": ("bare", {}, "pulses"),
    "azimuth": ("bare", {}, "angle"),
    "events": ("plain", {}, "pulses"),
    "pulses_per_revolution": ("bare", {"tach": "pulses"}, 2),
    "periods_per_revolution": ("bare", {"tach": "pulses"}, 2.0),
    "orbit": ("orbit", {}, False),
    "find_hits": ("twice", {}, True),
    "skip": ("plain", {}, 5.0),
    "repair": ("fault", {}, False),
}
"""Options that change what is identified: record, options beside, and the value."""

FITTED = {
    "order": ("several", {}, 2),
    "harmonics": ("plain", {}, 1),
    "identifier": ("plain", {}, "era"),
    "mode_false_alarm": ("faint", {"repair": False}, 1e-300),
    "harmonic_false_alarm": ("plain", {}, 0.3),
    "seconds": ("plain", {}, 1e-9),
    "noise_floor": ("plain", {}, 0.2),
    "constrained": ("plain", {}, False),
    "trust_period": ("wrong", {"channels": ("x0",)}, True),
    "forced": ("plain", {}, "3"),
    "branch": ("plain", {}, "slowest"),
    "validate": ("plain", {}, True),
}
"""Options that change the fit or its verdict."""

STATES = {"free": ("x0", "x1"), "inputs": ("x0",), "ambient": ("x0",)}
BUILT = {
    "states": ({}, None),
    "form": ({}, "first-order"),
    "delay": ({"form": "delayed"}, 0.3),
    "structure": ({}, "stiffness 2; damping 0"),
    "output_error": ({"structure": "stiffness 2; damping 0"}, True),
    "system_times": ({}, 7),
}
"""Options of A(t), which is built of a fit: options beside, and the value."""


def long(kind, name):
    """True of cells that take a second or more."""
    return kind == "ambient" or name == "trust_period"


CELLS = [(kind, name) for kind in KINDS for name in [*PREPARED, *FITTED, *BUILT]]


def numbers(*arrays):
    return tuple(np.asarray(own).tobytes() for own in arrays)


@cache
def prepared(kind, which, beside):
    found = prepare(record(kind, which), **KINDS[kind], **dict(beside))
    own = found.parted and found.parted.samples
    parts = (own.values, own.known, own.there, own.fundamental) if own else ()
    values = [response.values for response in found.responses]
    return (
        numbers(*values, *parts, [clock.period for clock in found.clocks]),
        own and own.hold,
        found.responses[0].start,
    )


@cache
def identified(kind, which, beside=()):
    """An analysis, or the refusal."""
    try:
        return identify(record(kind, which), **KINDS[kind], **{"validate": False, **dict(beside)})
    except FloquidError as error:
        return str(error)


def fitted(kind, which, beside):
    """What came of a fit: its exponents and deviations, what was found, or the refusal."""
    # The free response of the rotor is of several modes as it is.
    found = identified(kind, "plain" if (kind, which) == ("free", "several") else which, beside)
    if isinstance(found, str):
        return found
    model, codes = found.model, [(own.code, own.severity) for own in found.findings]
    return numbers(model.exponents, model.exponent_std, model.coefficients), codes, found.validation is None


def built(kind, options):
    """A(t) of a fit, or the refusal: what states a model of two channels can have is its kind's own matter."""
    found = identified(kind, "plain")
    free = found.decay and again_of(found.decay.fit, found.lifted, found.shafts)
    again = free or found.driven.estimates_at
    try:
        state, refined = state_of(found.model, replace(found.settings, **options), again, lambda _: None)
    except FloquidError as error:
        return str(error)
    return None if state is None else numbers(state.system, state.times), refined is None


def test_every_option_has_a_cell():
    named = {field.name for field in fields(Settings)} - {"inputs", "excitation"}
    assert named == {*PREPARED, *FITTED, *BUILT}
    assert all(set(reasons) <= named for reasons in FORBIDDEN.values())
    assert set(FORBIDDEN) == set(WORDS) == set(KINDS)


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind, reasons in FORBIDDEN.items() for name in reasons])
def test_an_option_that_a_kind_cannot_have_says_why(kind, name):
    which, beside, value = (PREPARED | FITTED)[name]
    reason = FORBIDDEN[kind][name]
    with pytest.raises(
        InputError, match=rf"`{name}` of `identify` must be left as it is {WORDS[kind]}.*\n  (?i:{reason})"
    ):
        identify(record(kind, which), **KINDS[kind], **beside, **{name: value})


@pytest.mark.parametrize(("kind", "name"), [cell for cell in CELLS if cell[1] in PREPARED])
def test_an_option_changes_what_is_identified(kind, name):
    if name in FORBIDDEN[kind]:
        return
    which, beside, value = PREPARED[name]
    if which == "bare" and not beside:
        with pytest.raises(InputError, match="have a clock"):
            prepare(record(kind, which), **KINDS[kind])
        found = prepare(record(kind, which), **KINDS[kind], **{name: value})
        assert found.shafts or found.clocks[0].fitted  # coarse pulses of a steady shaft say where to start
        return
    plain, other = (prepared(kind, which, tuple({**beside, **own}.items())) for own in ({}, frozen(name, value)))
    assert plain != other


def frozen(name, value):
    return {name: tuple(value) if isinstance(value, list) else value}


@pytest.mark.parametrize(
    ("kind", "name"),
    [pytest.param(*cell, marks=[pytest.mark.slow] * long(*cell)) for cell in CELLS if cell[1] in FITTED],
)
def test_an_option_changes_the_fit(kind, name):
    if name in FORBIDDEN[kind]:
        return
    which, beside, value = FITTED[name]
    plain, other = (fitted(kind, which, tuple({**beside, **own}.items())) for own in ({}, {name: value}))
    assert plain != other


@pytest.mark.parametrize("kind", [pytest.param(kind, marks=[pytest.mark.slow] * (kind == "ambient")) for kind in KINDS])
def test_harmonics_are_as_many_as_asked_for(kind):
    """An option that chooses another way to fit changes the fit where its value is ignored, too."""
    if "harmonics" not in FORBIDDEN[kind]:
        # A mode is counted from its strongest line, which may be any of them.
        kept = (identified(kind, "plain", (("harmonics", 2),)).model.coefficients != 0.0).any(axis=(1, 2))
        assert kept.sum(axis=1).tolist() == [5] * len(kept)


@pytest.mark.parametrize(
    ("kind", "name"),
    [pytest.param(*cell, marks=[pytest.mark.slow] * long(*cell)) for cell in CELLS if cell[1] in BUILT],
)
def test_an_option_changes_the_state_matrix(kind, name):
    beside, value = BUILT[name]
    if name == "states":
        assert built(kind, {}) == (None, True)
        assert isinstance(built(kind, {"states": STATES[kind]}), tuple)
        return
    beside = {"states": STATES[kind], **beside}
    plain = built(kind, beside)
    assert isinstance(plain, tuple)
    assert plain != built(kind, {**beside, name: value})


@pytest.mark.slow
@pytest.mark.parametrize("kind", [pytest.param("inputs"), pytest.param("ambient", marks=pytest.mark.slow)])
def test_a_search_stops_at_the_order(kind):
    plain = identify(record(kind, "several"), **KINDS[kind], validate=False)
    assert plain.model.order == 4
    found = identify(record(kind, "several"), **KINDS[kind], order=2, validate=False)
    assert found.model.order == 2
    assert "other_order" not in {own.code for own in found.findings}
