"""Every core type through the same laws: frozen, keyword-only, read-only arrays, and each bad argument refused."""

import copy
import dataclasses
import re

import numpy as np
import pytest

from floquid.core import Channel, ConstantPeriod, Cycles, PeriodicModel, Provenance, Record, channels_named
from floquid.errors import InputError

FOUR_PARTS = r"^Argument `{argument}` of `{of}` must .+, but .+\.(\n  \S.+\.)?$"


def record(**changes):
    return Record(**({"values": np.arange(6.0).reshape(2, 3), "sample_rate": 10.0, "channels": ["X", "Y"]} | changes))


def cycles(**changes):
    valid = {"values": np.arange(24.0).reshape(2, 3, 4), "periods": np.full(4, 0.5), "channels": ["X", "Y"]}
    return Cycles(**(valid | changes))


def model(**changes):
    valid = {
        "exponents": np.array([-0.1 + 2j, -0.1 - 2j]),
        "coefficients": np.arange(24.0).reshape(2, 2, 2, 3) + 1j,
        "harmonics": np.array([-1, 0, 1]),
        "period": 2.0,
        "channels": ["X", "Y"],
        "covariance": np.diag([1.0, 4.0, 9.0, 16.0]),
        "coefficient_std": np.ones((2, 2, 2, 3), dtype=complex),
    }
    return PeriodicModel(**(valid | changes))


def channel(**changes):
    return Channel(**({"name": "X"} | changes))


def clock(**changes):
    return ConstantPeriod(**({"period": 0.5} | changes))


MAKERS = {"Record": record, "Cycles": cycles, "PeriodicModel": model, "Channel": channel, "ConstantPeriod": clock}
EVERY = pytest.mark.parametrize("make", [*MAKERS.values(), Provenance], ids=[*MAKERS, "Provenance"])

ARRAYS = [
    (record, "values"),
    (cycles, "values"),
    (cycles, "periods"),
    (model, "exponents"),
    (model, "coefficients"),
    (model, "harmonics"),
    (model, "covariance"),
    (model, "coefficient_std"),
]
EVERY_ARRAY = pytest.mark.parametrize(("make", "name"), ARRAYS, ids=[f"{m.__name__}-{n}" for m, n in ARRAYS])


@EVERY
def test_frozen_keyword_only_and_slotted(make):
    made = make()
    names = [field.name for field in dataclasses.fields(made)]
    for name in names:
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(made, name, None)
    with pytest.raises(TypeError, match="positional"):
        type(made)(*(getattr(made, name) for name in names))
    assert not hasattr(made, "__dict__")


@EVERY
def test_replace_without_a_change_changes_nothing(make):
    made = make()
    again = dataclasses.replace(made)
    for field in dataclasses.fields(made):
        old, new = getattr(made, field.name), getattr(again, field.name)
        assert new is old if isinstance(old, np.ndarray) else new == old


@EVERY_ARRAY
def test_arrays_are_read_only(make, name):
    with pytest.raises(ValueError, match="read-only"):
        getattr(make(), name).flat[0] = 0


@EVERY_ARRAY
def test_a_writable_array_is_copied(make, name):
    mine = np.array(getattr(make(), name))
    held = getattr(make(**{name: mine}), name)
    assert not np.shares_memory(mine, held)
    assert mine.flags.writeable
    np.testing.assert_array_equal(mine, held)


@EVERY_ARRAY
def test_a_read_only_array_is_taken_as_it_is(make, name):
    mine = np.array(getattr(make(), name))
    mine.flags.writeable = False
    assert getattr(make(**{name: mine}), name) is mine


@EVERY_ARRAY
def test_a_list_does_as_well(make, name):
    held = getattr(make(), name)
    given = getattr(make(**{name: held.tolist()}), name)
    assert given.dtype == held.dtype
    np.testing.assert_array_equal(given, held)


@EVERY_ARRAY
def test_a_deep_copy_is_rebuilt_read_only_by_the_constructor(make, name):
    again = dataclasses.replace(copy.deepcopy(make()))
    assert not getattr(again, name).flags.writeable


@EVERY_ARRAY
@pytest.mark.parametrize(
    "wrong",
    [lambda a: a[0], lambda a: a[None], lambda a: np.full(a.shape, np.inf)],
    ids=["axis missing", "axis too many", "infinite"],
)
def test_wrong_shapes_and_infinities_are_refused(make, name, wrong):
    with pytest.raises(InputError, match=FOUR_PARTS.format(argument=name, of=type(make()).__name__)):
        make(**{name: wrong(getattr(make(), name))})


@EVERY_ARRAY
@pytest.mark.parametrize("wrong", ["text", [[1.0], [1.0, 2.0]], np.array([object()]), object()], ids=type)
def test_what_is_no_array_of_numbers_is_refused(make, name, wrong):
    with pytest.raises(InputError, match=FOUR_PARTS.format(argument=name, of=type(make()).__name__)):
        make(**{name: wrong})


@EVERY_ARRAY
def test_none_is_refused_where_something_is_needed(make, name):
    if name in ("covariance", "coefficient_std"):
        assert getattr(make(**{name: None}), name) is None
        return
    with pytest.raises(InputError, match=FOUR_PARTS.format(argument=name, of=type(make()).__name__)):
        make(**{name: None})


REFUSED = [
    # the axes
    (record, "values", np.zeros((3, 2)), "Time is the last axis: pass `values.T`."),
    (record, "values", np.zeros((4, 3)), "Name every row of `values` in `channels`."),
    (record, "values", np.zeros(3), "pass `values[None, :]`"),
    (record, "values", np.zeros((2, 0)), "hold at least one sample"),
    (cycles, "values", np.zeros((3, 3, 4)), "have shape (2, phases, cycles), but has shape (3, 3, 4)"),
    (cycles, "values", np.zeros((2, 0, 4)), "at least one phase and one cycle"),
    (cycles, "periods", np.ones(3), "have shape (4,), but has shape (3,)"),
    (model, "coefficients", np.zeros((1, 2, 2, 3)), "have shape (2, 2, hits, 3)"),
    (model, "coefficients", np.zeros((2, 3, 2, 3)), "have shape (2, 2, hits, 3)"),
    (model, "coefficients", np.zeros((2, 2, 2, 4)), "have shape (2, 2, hits, 3)"),
    (model, "covariance", np.eye(2), "have shape (4, 4), but has shape (2, 2)"),
    (model, "coefficient_std", np.zeros((2, 2, 1, 3)), "have shape (2, 2, 2, 3)"),
    # the values
    (record, "values", np.zeros((2, 3)) + 1j, "be real"),
    (cycles, "periods", [1.0, 1.0, 0.0, 1.0], "be positive [s], but has 0"),
    (cycles, "periods", [1.0, 1.0, np.nan, 1.0], "be finite"),
    (cycles, "first_phase", 1.0, "lie in [0, 1)"),
    (cycles, "first_phase", -0.1, "lie in [0, 1)"),
    (cycles, "first_phase", np.nan, "be a finite number"),
    (model, "exponents", [np.nan, 1.0], "be finite"),
    (model, "coefficients", np.full((2, 2, 2, 3), np.nan), "be finite"),
    (model, "harmonics", [-1, 1, 0], "ascend"),
    (model, "harmonics", [0, 0, 1], "ascend"),
    (model, "harmonics", [-1.5, 0.0, 1.0], "hold integers, but has -1.5"),
    (model, "covariance", -np.eye(4), "have no negative variance"),
    *(
        (make, "period", wrong, "[s]")
        for make in (model, clock)
        for wrong in (0.0, -1.0, np.nan, np.inf, "2", None, True)
    ),
    *((record, "sample_rate", wrong, "[Hz]") for wrong in (0.0, -48000.0, np.nan, np.inf, "48 kHz", None, False)),
    (record, "start", np.inf, "be a finite number [s]"),
    (clock, "origin", np.nan, "be a finite number [s]"),
    (record, "clock", 0.02, "Pass ConstantPeriod(period=...)."),
    # the channels
    *((make, "channels", "XY", "be a list of Channel or of names") for make in (record, cycles, model)),
    *((make, "channels", [], "at least one") for make in (record, cycles, model)),
    *((make, "channels", ["X", 3], "be a list of Channel or of names") for make in (record, cycles, model)),
    *((make, "channels", ["X", "X"], "'X' twice") for make in (record, cycles, model)),
    (record, "channels", ["X", " X "], "'X' twice"),
    (channel, "name", "  ", "be a word"),
    (channel, "name", None, "be a word"),
    (channel, "unit", 3, "be a text"),
    (channel, "quantity", "speed", "be one of displacement, velocity"),
]


@pytest.mark.parametrize(
    ("make", "argument", "wrong", "words"),
    REFUSED,
    ids=[f"{make.__name__}-{argument}-{i}" for i, (make, argument, *_) in enumerate(REFUSED)],
)
def test_refused(make, argument, wrong, words):
    of = type(make()).__name__
    with pytest.raises(InputError, match=FOUR_PARTS.format(argument=argument, of=of)) as raised:
        make(**{argument: wrong})
    assert words in str(raised.value)


@EVERY_ARRAY
def test_replace_keeps_the_invariants(make, name):
    made = make()
    with pytest.raises(InputError, match=FOUR_PARTS.format(argument=name, of=type(made).__name__)):
        dataclasses.replace(made, **{name: np.zeros((1, 1, 1, 1, 1))})


class TestRecord:
    def test_missing_samples_are_kept(self):
        assert np.isnan(record(values=[[0.0, np.nan, 1.0], [0.0, 0.0, 0.0]]).values[0, 1])

    def test_time(self):
        made = record(start=-0.5)
        assert (made.n_channels, made.n_samples, made.duration) == (2, 3, 0.3)
        np.testing.assert_allclose(made.times, [-0.5, -0.4, -0.3], rtol=1e-15)

    def test_select_takes_the_order_asked_for(self):
        chosen = record(clock=clock(), start=2.0).select(["Y", "X"])
        assert [c.name for c in chosen.channels] == ["Y", "X"]
        np.testing.assert_array_equal(chosen.values, [[3.0, 4.0, 5.0], [0.0, 1.0, 2.0]])
        assert not chosen.values.flags.writeable
        assert (chosen.clock, chosen.start) == (clock(), 2.0)

    @pytest.mark.parametrize(("names", "words"), [(["Z"], "has 'Z'"), (["X", "X"], "'X' twice"), ("X", "be a list")])
    def test_select_refuses(self, names, words):
        with pytest.raises(InputError, match=FOUR_PARTS.format(argument="names", of=r"Record\.select")) as raised:
            record().select(names)
        assert words in str(raised.value)
        assert "The channels are: X, Y." in str(raised.value)

    def test_with_clock(self):
        plain = record()
        tied = plain.with_clock(clock())
        assert (plain.clock, tied.clock) == (None, clock())
        assert tied.values is plain.values


class TestCycles:
    def test_sizes(self):
        made = cycles(periods=[0.4, 0.6, 0.5, 0.7])
        assert (made.n_channels, made.n_phases, made.n_cycles) == (2, 3, 4)
        assert made.period == pytest.approx(0.55, rel=1e-15)


class TestConstantPeriod:
    @pytest.mark.parametrize(
        ("time", "phase"), [(1.0, 0.0), (1.125, 0.25), (0.875, 0.75), (1.5, 0.0), (-99.0, 0.0), (1.0 - 1e-12, 0.0)]
    )
    def test_phase(self, time, phase):
        assert clock(origin=1.0).phase(time) == phase

    def test_fundamental(self):
        assert clock(period=0.25).fundamental == pytest.approx(8 * np.pi, rel=1e-15)


class TestChannel:
    @pytest.mark.parametrize(
        ("unit", "quantity"),
        [
            ("-", "displacement"), ("", "displacement"), ("1", "displacement"), (" mm ", "displacement"),
            ("µm", "displacement"), ("μm", "displacement"), ("rad", "displacement"), ("m/s", "velocity"),
            ("rad/s", "velocity"), ("m/s^2", "acceleration"), ("g", "acceleration"), ("rad/s²", "acceleration"),
            ("N", "force"), ("strain", "strain"), ("µε", "strain"), ("V", "other"), ("furlong", "other"),
        ],
    )  # fmt: skip
    def test_quantity_follows_from_the_unit(self, unit, quantity):
        assert channel(unit=unit).quantity == quantity

    @pytest.mark.parametrize(
        ("name", "unit", "quantity"),
        [
            ("acc", "-", "acceleration"), ("accX", "-", "acceleration"), ("ACC_3", "V", "acceleration"),
            ("tip accel", "-", "acceleration"), ("vel_y", "-", "velocity"), ("disp 1", "-", "displacement"),
            ("acc", "m", "displacement"), ("TTDspFA", "-", "displacement"), ("hammer", "V", "force"),
            ("RotTorque", "-", "force"), ("tach", "V", "pulse"), ("Rotor_Azimuth", "deg", "angle"),
            ("encoder", "rad", "angle"), ("encoder", "V", "pulse"), ("LSSTipPxa", "deg", "angle"),
            ("accuracy", "-", "displacement"), ("vaccum", "V", "other"), ("reinforced", "-", "displacement"),
        ],
    )  # fmt: skip
    def test_what_the_unit_leaves_open_a_word_in_the_name_says(self, name, unit, quantity):
        assert channel(name=name, unit=unit).quantity == quantity

    @pytest.mark.parametrize(
        ("unit", "quantity"),
        [("rad", "angle"), ("V", "acceleration"), ("-", "velocity"), ("-", "pulse"), ("mm", "pulse"), ("N", "other")],
    )
    def test_a_quantity_that_the_unit_allows_is_kept(self, unit, quantity):
        assert channel(unit=unit, quantity=quantity).quantity == quantity

    @pytest.mark.parametrize(
        ("unit", "quantity"), [("mm", "velocity"), ("m/s", "displacement"), ("g", "force"), ("N", "angle")]
    )
    def test_a_unit_of_something_else_is_refused(self, unit, quantity):
        with pytest.raises(InputError, match=FOUR_PARTS.format(argument="unit", of="Channel")) as raised:
            channel(unit=unit, quantity=quantity)
        assert f"be a unit of {quantity}, but is {unit!r}" in str(raised.value)
        assert "Correct the unit, or pass quantity=" in str(raised.value)

    def test_label_and_equality(self):
        assert channel(name=" X ", unit=" mm ").label == "X [mm]"
        assert channel(unit="") == channel(unit="-", quantity="displacement")
        assert channel(unit="mm") != channel(unit="m")


class TestPeriodicModelFields:
    def test_sizes(self):
        made = model()
        assert (made.order, made.n_hits) == (2, 2)
        assert made.fundamental == pytest.approx(np.pi, rel=1e-15)

    def test_std_is_complex_part_by_part(self):
        np.testing.assert_array_equal(model().exponent_std, [1 + 3j, 2 + 4j])

    def test_none_means_not_estimated(self):
        bare = model(covariance=None, coefficient_std=None)
        assert (bare.covariance, bare.coefficient_std, bare.exponent_std) == (None, None, None)


class TestProvenance:
    def test_then_adds_at_the_end_and_changes_nothing(self):
        first = Provenance(sources=("a.npz",), steps=("read",))
        assert first.then("lifted", "fitted").steps == ("read", "lifted", "fitted")
        assert first.steps == ("read",)

    def test_merge_names_each_thing_once(self):
        merged = Provenance.merge(
            (
                Provenance(sources=("a",), steps=("read", "cut")),
                Provenance(sources=("b", "a"), steps=("read", "lifted")),
            )
        )
        assert merged == Provenance(sources=("a", "b"), steps=("read", "cut", "lifted"))


def test_channels_named_says_whose_argument_is_wrong():
    known = [channel(name="X"), channel(name="Y")]
    assert channels_named(known, ["Y", "X"], argument="states", of="reconstruct") == [1, 0]
    with pytest.raises(
        InputError, match=re.escape("Argument `states` of `reconstruct` must name channels of the record")
    ):
        channels_named(known, ["Z"], argument="states", of="reconstruct")
