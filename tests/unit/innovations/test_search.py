"""The search for modes of outputs alone."""

from tests.driven import ambient_of, parted, pulls

from floquid import ConstantPeriod, Record, identify_ambient


def test_a_real_multiplier_that_grows_has_its_partner():
    """Without it what was left looked white, and the growth was 3.2 of its deviations off."""
    system = parted()
    values = ambient_of(system, 300, 16, 0.02, 8, warm=40)
    record = Record(values=values, sample_rate=800.0, channels=["x", "z"], clock=ConstantPeriod(period=0.02))
    model = identify_ambient(record, validate=False).model
    assert model.order == 4
    assert pulls(system, model).max() < 2.5
