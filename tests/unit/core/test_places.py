"""Frame, group, member and axis of a channel, by its name or as given, and kept by files and results."""

import pytest

import floquid as fq
from floquid.core import Channel

BLADES = {
    "flap1": ("flap", 1),
    "edge_2": ("edge", 2),
    "Blade 3 flapwise": ("flapwise", 3),
    "b2_edge": ("edge", 2),
    "RootMyb2": ("RootMyb", 2),
    "Spn4MLxb1": ("Spn4MLxb", 1),
    "OoPDefl3": ("OoPDefl", 3),
    "Q_B1F1": ("Q_F1", 1),
    "B2N3Fx": ("N3Fx", 2),
}


@pytest.mark.parametrize("name", BLADES)
def test_members_of_blades_by_name(name):
    channel = Channel(name=name)
    assert (channel.frame, channel.group, channel.member) == ("rotating", *BLADES[name])


@pytest.mark.parametrize("name", ["x", "acc1", "y2", "u0", "flag1", "strip1", "RotSpeed", "A1", "edge", "Hammer"])
def test_names_that_tell_nothing(name):
    assert Channel(name=name).place == ""


def test_axes():
    assert Channel(name="disc x").axis == Channel(name="A1", direction="+X").axis == "x"
    assert Channel(name="A1", direction="-X").axis is None
    assert (Channel(name="YawBrTAyp").frame, Channel(name="YawBrTAyp").axis) == ("fixed", "y")


def test_what_is_given_wins():
    assert Channel(name="flap1", frame="fixed").place == "frame=fixed"
    blade = Channel(name="g7", frame="rotating", group="flap", member=2, angle=0.5)
    assert blade.place == "frame=rotating; group=flap; member=2; angle=0.5"


@pytest.mark.parametrize("wrong", [{"frame": "moving"}, {"axis": "r"}, {"member": 0}, {"angle": "wide"}])
def test_what_cannot_be_is_refused(wrong):
    with pytest.raises(fq.InputError, match=next(iter(wrong))):
        Channel(name="g", **wrong)


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".mat", ".csv", ".uff"])
def test_files_hold_places(tmp_path, suffix):
    channels = [Channel(name="g", frame="rotating", group="flap", member=2, angle=0.5), Channel(name="h", axis="y")]
    record = fq.Record(values=[[1.0, 2.0], [3.0, 4.0]], sample_rate=1.0, channels=channels)
    fq.write(record, tmp_path / f"r{suffix}")
    assert fq.read(tmp_path / f"r{suffix}").channels == record.channels
    assert fq.from_sep005(fq.to_sep005(record)).channels == record.channels
    assert fq.from_pandas(fq.to_pandas(record)).channels == record.channels
    assert fq.from_xarray(fq.to_xarray(record)).channels == record.channels
