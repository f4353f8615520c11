"""`result.h5`: what is saved comes back, field by field; what is no such file is refused in words."""

import errno
import shutil
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from tests.decays import with_decay
from threadpoolctl import threadpool_limits

import floquid
from floquid.core import AzimuthSignal, Channel, ConstantPeriod, Provenance, PulseTimes, Record
from floquid.errors import InputError
from floquid.exports import summary
from floquid.findings import Finding, warning
from floquid.pipeline import Settings, identify
from floquid.reconstruction import Block
from floquid.store import _files, load, save
from floquid.systems import JeffcottRotor, Run

ROTOR = JeffcottRotor(damping=0.02)


def two_hits():
    """Two records of unequal length, with units, an odd start and a history."""
    channels = [
        Channel(name="x", unit="mm", location="disc", direction="X"),
        Channel(name="y", unit="mm", location="disc", direction="Y"),
        Channel(name="tilt µ", quantity="other", unit="V"),
    ]
    for n_periods, seed, angle in ((30, 1, 20.0), (24, 2, 75.0)):
        record = ROTOR.simulate(
            n_periods=n_periods, samples_per_period=8, noise=0.01, seed=seed, impulse_deg=angle, first_phase=0.25
        )
        yield Record(
            values=record.values[:3, :-3],
            sample_rate=record.sample_rate,
            channels=channels,
            clock=record.clock,
            start=record.start,
            provenance=Provenance(sources=(f"hit {angle}.csv", "ümlaut")).then("read", "cut"),
        )


@pytest.fixture(scope="module")
def full():
    """An analysis in which no field is empty."""
    found = identify(
        list(two_hits()), states=["x", "y"], channels=["x", "y", "tilt µ"], period=ROTOR.period, structure="auto"
    )
    structure = replace(found.refinement.structure, damping=Block(known={(0, 1): 0.1 + 0.2}))
    refinement = replace(found.refinement, structure=structure)
    wide = found.model.unselected
    model = replace(found.model, unselected=replace(wide, bend=0.1j * wide.scales))
    fit = replace(found.fit, model=model)
    said = (Finding("sentence", "warning", words="of the first kind"), warning("product", frequency=1.5, of=(0.5, 1.0)))
    return with_decay(replace(found, model=model, refinement=refinement, findings=(*found.findings, *said)), fit=fit)


@pytest.fixture(scope="module")
def bare():
    """An analysis in which everything that may be None is."""
    record = ROTOR.simulate(n_periods=30, samples_per_period=8, noise=0.01)
    found = identify(record, order=4, validate=False)
    modal = replace(found.modal, covariance=None, residue_spread=None, residue_slope=None, residual_std=None, stats={})
    model = replace(found.model, covariance=None, coefficient_std=None)
    return with_decay(replace(found, model=model), modal=modal, fit=replace(found.fit, model=model))


@pytest.fixture(scope="module")
def content(full, tmp_path_factory):
    """The bytes of its file."""
    path = tmp_path_factory.mktemp("saved") / "result.h5"
    save(full, path)
    return path.read_bytes()


@pytest.fixture
def saved(content, tmp_path):
    path = tmp_path / "result.h5"
    path.write_bytes(content)
    return path


NOT_STORED = {"analysis.decay.choice.runner_up", "analysis.decay.choice.evidence"}
"""What a file need not hold, and a result that is read has None for."""


def differences(one, other, name="analysis"):
    """The names of the fields in which two trees of values differ, in type, shape, number or text."""
    if name in NOT_STORED and other is None:
        return
    if type(one) is not type(other):
        yield f"{name}: {type(one).__name__} or {type(other).__name__}"
    elif is_dataclass(one):
        for field in fields(one):
            yield from differences(getattr(one, field.name), getattr(other, field.name), f"{name}.{field.name}")
    elif isinstance(one, np.ndarray):
        if one.dtype != other.dtype or one.flags.writeable != other.flags.writeable:
            yield f"{name}: {one.dtype}, writable {one.flags.writeable}, or {other.dtype}, {other.flags.writeable}"
        if not np.array_equal(one, other, equal_nan=one.dtype.kind == "f"):
            yield name
    elif isinstance(one, Mapping):
        yield from differences(dict(one), dict(other), name) if not isinstance(one, dict) else ()
        if one != other:
            yield name
    elif isinstance(one, tuple):
        if len(one) != len(other):
            yield f"{name}: {len(one)} or {len(other)} entries"
        for index, pair in enumerate(zip(one, other, strict=False)):
            yield from differences(*pair, f"{name}[{index}]")
    elif one != other:
        yield f"{name}: {one!r} or {other!r}"


def test_every_field_comes_back(full, saved):
    assert list(differences(full, load(saved))) == []


def test_a_refinement_keeps_its_own_state(full, tmp_path):
    """By custom it is that of the analysis, and the file has it once."""
    save(full, tmp_path / "one.h5")
    assert (back := load(tmp_path / "one.h5")).refinement.state is back.state
    other = replace(full, state=replace(full.state, system=full.state.system * 2.0))
    save(other, tmp_path / "two.h5")
    assert list(differences(other, load(tmp_path / "two.h5"))) == []
    save(replace(full, state=None), tmp_path / "three.h5")
    assert list(differences(replace(full, state=None), load(tmp_path / "three.h5"))) == []


def test_estimates_may_know_their_slopes_at_one_place_alone(full, tmp_path):
    model = replace(full.model, estimates=replace(full.model.estimates, drift=None))
    save(replace(full, model=model), tmp_path / "r.h5")
    back = load(tmp_path / "r.h5").model
    assert list(differences(model, back)) == []
    assert (back.estimates.drift, back.estimates.bend) == (None, None)


def test_what_there_is_none_of_is_none(full, tmp_path):
    none = replace(full, model=replace(full.model, estimates=None, unselected=None), refinement=None)
    save(replace(none, state=replace(full.state, transition_std=None)), tmp_path / "r.h5")
    back = load(tmp_path / "r.h5")
    assert (back.model.estimates, back.model.unselected, back.refinement) == (None, None, None)
    assert back.state.transition_std is None
    assert np.array_equal(back.state.system_std, full.state.system_std)


def test_the_summary_has_every_deviation(full):
    found = summary(full)
    model, state, refined = full.model, full.state, full.refinement
    for r, mode in enumerate(found["modes"]):
        assert complex(*mode["multiplier_std"]) == model.multiplier_std[r]
        assert mode["frequency_std_hz"] == model.frequency_std_hz[r]
        assert mode["damping_ratio_std"] == model.damping_ratio_std[r]
    assert found["system"]["coordinates"] == state.coordinates == "second-order form from x, y"
    assert found["system"]["std"] == state.system_std.tolist()
    said = found["system"]["structure"]
    assert said["text"].endswith("damping 0 known 0,1=0.30000000000000004")
    assert (said["chi_square"], said["degrees"], said["p_value"]) == (
        *(refined.chi_square, refined.degrees),
        refined.p_value,
    )
    assert [one["name"] for one in said["parameters"]] == list(refined.names)
    assert [one["value"] for one in said["parameters"]] == refined.parameters.tolist()
    assert [one["std"] for one in said["parameters"]] == refined.std.tolist()
    bare = replace(full, refinement=None, model=replace(model, covariance=None), state=replace(state, system_std=None))
    nothing = summary(bare)
    assert (nothing["system"]["std"], nothing["system"]["structure"]) == (None, None)
    assert {nothing["modes"][0][f"{name}_std"] for name in ("exponent", "multiplier", "damping_ratio")} == {None}
    assert nothing["modes"][0]["frequency_std_hz"] is None


def test_what_is_none_comes_back_as_none(bare, tmp_path):
    save(bare, tmp_path / "r.h5")
    back = load(tmp_path / "r.h5")
    assert list(differences(bare, back)) == []
    assert back.state is None
    assert back.model.covariance is None
    assert back.settings.period is None
    assert back.warnings == ()


def test_the_comparison_can_fail(full):
    noise = full.lifted.noise * (1 + 1e-15)
    others = [
        with_decay(full, lifted=full.lifted.with_noise(noise)),
        replace(full, settings=replace(full.settings, order=4)),
        replace(full, model=replace(full.model, covariance=None)),
        with_decay(full, modal=replace(full.modal, stats={**full.modal.stats, "cost": 1.0})),
        replace(full, findings=full.findings[:1]),
        replace(full, model=replace(full.model, provenance=Provenance())),
        replace(full, model=replace(full.model, estimates=None)),
        replace(full, model=replace(full.model, unselected=full.model.estimates)),
        replace(full, state=replace(full.state, coordinates="others")),
        replace(full, state=replace(full.state, transition_std=None)),
        replace(full, refinement=replace(full.refinement, p_value=0.5)),
        replace(full, refinement=replace(full.refinement, findings=())),
    ]
    assert [len(list(differences(full, other))) > 0 for other in others] == [True] * len(others)


@pytest.mark.parametrize(
    "settings",
    [
        Settings(),
        Settings(order=4, harmonics=0, states=("x", "y"), system_times=7, mode_false_alarm=1e-3),
        Settings(period=0.1 + 0.2, channels=("x",), harmonic_false_alarm=1e-8 / 3),
        Settings(states=("x", "y+vy"), structure="stiffness 1; damping 0 known 0,1=0.1", output_error=True),
        Settings(states=("x",), form="delayed", delay=0.1 + 0.2),
    ],
)
def test_settings_keep_their_values_and_types(bare, settings, tmp_path):
    save(replace(bare, settings=settings), tmp_path / "r.h5")
    assert list(differences(settings, load(tmp_path / "r.h5").settings)) == []


def test_numbers_of_numpy_among_the_settings_are_numbers(bare, tmp_path):
    settings = Settings(order=np.int32(4), mode_false_alarm=np.float64(1e-9))
    save(replace(bare, settings=settings), tmp_path / "r.h5")
    assert load(tmp_path / "r.h5").settings == settings


def test_a_setting_that_a_file_has_no_form_for_is_not_dropped_in_silence(bare, tmp_path):
    odd = replace(bare.settings)
    object.__setattr__(odd, "order", {"a": 1})
    with pytest.raises(TypeError, match="order"):
        save(replace(bare, settings=odd), tmp_path / "r.h5")
    assert list(tmp_path.iterdir()) == []


def test_the_summary_of_a_loaded_result_is_that_of_the_saved_one(full, saved):
    assert summary(load(saved)) == summary(full)


def test_the_same_analysis_gives_the_same_bytes(full, saved, tmp_path):
    save(load(saved), tmp_path / "again.h5")
    assert (tmp_path / "again.h5").read_bytes() == saved.read_bytes()


def test_texts_that_hdf5_cannot_hold_are_written_as_escapes(bare, tmp_path):
    odd = Provenance(sources=("caf\udce9.csv", "nul\0l"))
    save(replace(bare, model=replace(bare.model, provenance=odd)), tmp_path / "r.h5")
    assert load(tmp_path / "r.h5").model.provenance.sources == ("caf\\udce9.csv", "nul\\x00l")


def test_the_file_describes_itself(saved):
    """Version and units are attributes, complex numbers are compounds of r and i, and the page names each dataset."""
    names = []
    with h5py.File(saved) as file:
        assert dict(file.attrs) == {"format": "floquid-result", "version": 4, "floquid": floquid.__version__}
        assert dict(file["model/exponents"].attrs) == {"axes": "modes", "unit": "1/s"}
        kind = file["model/exponents"].id.get_type()
        assert [kind.get_member_name(k) for k in range(kind.get_nmembers())] == [b"r", b"i"]
        assert file["records/hit2/values"].fletcher32
        file.visit(names.append)
    page = floquid.store.__doc__
    words = {word.strip(",;():") for word in page.replace("/", " ").split()}
    inside = {part for name in names for part in name.split("/")}
    unnamed = inside - words - {f.name for f in fields(Settings)} - {"cost", "degrees"}
    assert unnamed == set()


# Files that are refused. Each scenario: what is done to a good file, and words of the message.


def swap(name, data):
    """Put `data` in the place of the dataset `name`."""

    def change(file):
        del file[name]
        file[name] = data

    return change


def drop(name):
    def change(file):
        del file[name]

    return change


def attribute(name, value):
    def change(file):
        file.attrs[name] = value

    return change


def add_setting(file):
    file["settings/telepathy"] = 1.0


DAMAGE = {
    "no format": (lambda file: file.attrs.pop("format"), "no attribute `format`"),
    "another format": (attribute("format", "weather"), "no attribute `format`"),
    "no version": (lambda file: file.attrs.pop("version"), "damaged or not whole: 'version'"),
    "a version in words": (attribute("version", "one"), "damaged"),
    "a later version": (attribute("version", 5), "is of version 5, written by floquid"),
    "an earlier version": (attribute("version", 3), "is of version 3, written by floquid"),
    "no settings": (drop("settings"), "damaged"),
    "no second record": (drop("records/hit2"), "damaged"),
    "no exponents": (drop("model/exponents"), 'damaged or not whole: "Unable to'),
    "no order": (drop("settings/order"), "damaged"),
    "no delay": (drop("settings/delay"), "damaged"),
    "a setting of the future": (add_setting, "the setting 'telepathy'"),
    "a link to nowhere": (swap("model", h5py.SoftLink("/nowhere")), "damaged"),
    "None where there must be a value": (swap("model/period", h5py.Empty("f8")), "Argument `period`"),
    "one exponent less": (swap("model/exponents", np.ones(3, complex)), "Argument `coefficients`"),
    "a negative period": (swap("records/hit1/period", -1.0), "Argument `period` of `ConstantPeriod`"),
    "an unknown quantity": (swap("model/channels/quantity", ["luck"] * 3), "Argument `quantity`"),
    "channels of others": (swap("model/channels/name", ["a", "b", "c"]), "model/channels are not those of the records"),
    "an unknown outcome": (swap("decay/modal/outcome", "MAGIC"), "damaged or not whole: 'MAGIC'"),
    "half an order": (swap("settings/order", 4.5), "Argument `order` of `Settings`"),
    "a structure not found": (swap("refinement/structure", "auto"), "it has a refinement without a structure"),
}


@pytest.mark.parametrize("scenario", DAMAGE)
def test_a_damaged_file_is_refused_in_words(saved, scenario):
    change, words = DAMAGE[scenario]
    with h5py.File(saved, "r+") as file:
        change(file)
    with pytest.raises(InputError) as caught:
        load(saved)
    message = str(caught.value)
    first, remedy = message.split("\n  ")
    assert first.startswith("Argument `path` of `load` must be a result file")
    assert str(saved) in first
    assert words in first
    assert remedy.startswith(("Write it again", "Update floquid"))


def test_the_damage_is_what_is_refused(saved):
    """The same handling without a change is accepted, so each refusal above is for its own reason."""
    with h5py.File(saved, "r+") as file:
        kept = {name: file[name][()] for name in ("model/period", "decay/fit/noise", "decay/modal/residues")}
        for name, data in kept.items():
            swap(name, data)(file)
    load(saved)


def other_axes(data):
    return np.repeat(np.asarray(data, dtype=object if isinstance(data, bytes) else None)[..., None], 2, axis=-1)


def other_kind(data):
    numbers = np.asarray(data).dtype.kind not in "OSU"
    return np.full(np.shape(data), "text", dtype=object) if numbers else np.ones(np.shape(data))


@pytest.mark.slow
@pytest.mark.parametrize("altered", [other_axes, other_kind])
def test_a_dataset_of_other_axes_or_another_kind_is_refused(saved, altered):
    """Each of all the datasets in turn but those of the settings, which are looked at one by one."""
    content, names, taken = saved.read_bytes(), [], []
    with h5py.File(saved) as file:
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        names = [name for name in names if not name.startswith("settings") and file[name].size]
    assert len(names) > 80
    for name in names:
        with h5py.File(saved, "r+") as file:
            data = altered(file[name][()])
            swap(name, data)(file)
        with suppress(InputError):
            load(saved)
            taken.append(name)
        saved.write_bytes(content)
    assert taken == []


@pytest.mark.parametrize("share", [0.0001, 0.001, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.99, 0.99999])
def test_a_truncated_file_is_refused(saved, share):
    content = saved.read_bytes()
    saved.write_bytes(content[: max(1, int(share * len(content)))])
    with pytest.raises(InputError, match=r"result\.h5 is (damaged|no HDF5 file)"):
        load(saved)


def test_a_changed_byte_of_an_array_is_seen(saved):
    with h5py.File(saved) as file:
        chunk = file["records/hit1/values"].id.get_chunk_info(0)
    content = bytearray(saved.read_bytes())
    content[chunk.byte_offset + chunk.size // 2] ^= 0x10
    saved.write_bytes(content)
    with pytest.raises(InputError, match="damaged"):
        load(saved)


@pytest.mark.parametrize("content", [b"", b"time,x\n0,1\n", b"PK\x03\x04 an archive", b"\x89HDF\r\n\x1a\n"])
def test_another_kind_of_file_is_refused(tmp_path, content):
    path = tmp_path / "other.h5"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"other\.h5 is"):
        load(path)


def test_what_is_no_file_is_refused(tmp_path):
    for path in (tmp_path, tmp_path / "none.h5", 3, ""):
        with pytest.raises(InputError, match="`path` of `load`"):
            load(path)


# Writing.


def test_only_an_analysis_is_saved(full, tmp_path):
    with pytest.raises(InputError, match="Argument `analysis` of `save` must be an Analysis"):
        save(full.model, tmp_path / "r.h5")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["r.npz", "r.mat", "r"])
def test_a_name_that_promises_another_format_is_refused(full, tmp_path, name):
    with pytest.raises(InputError, match=r"`path` of `save` must end in \.h5 or \.hdf5"):
        save(full, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_no_result_is_not_replaced(full, tmp_path):
    record = tmp_path / "record.h5"
    record.write_bytes(b"measured")
    with pytest.raises(InputError, match=r"`path` of `save` must be no file but a result, but .* holds something else"):
        save(full, record)
    assert record.read_bytes() == b"measured"


def test_a_folder_that_cannot_hold_the_file_is_refused(full, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    for path in (tmp_path / "none" / "r.h5", tmp_path / "file" / "r.h5", tmp_path):
        with pytest.raises(InputError, match="Argument `path` of `save` must be a path that can be written"):
            save(full, path)
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("exists", [True, False])
@pytest.mark.parametrize("error", [RuntimeError, MemoryError, KeyboardInterrupt, ValueError])
def test_a_failure_while_packing_leaves_what_was_there(full, bare, tmp_path, monkeypatch, error, exists):
    path = tmp_path / "r.h5"
    if exists:
        save(bare, path)
    before = path.read_bytes() if exists else None

    def fail(group, record):
        raise error("midway")

    with monkeypatch.context() as patch:
        patch.setattr(_files, "_put_record", fail)
        with pytest.raises(error, match="midway"):
            save(full, path)
    assert (path.read_bytes() if path.exists() else None) == before
    assert list(tmp_path.iterdir()) == ([path] if exists else [])


def test_a_disk_that_fails_midway_leaves_what_was_there(full, bare, tmp_path, monkeypatch):
    path = tmp_path / "r.h5"
    save(bare, path)
    before = path.read_bytes()

    def write_half(self, data):
        with self.open("wb") as stream:
            stream.write(data[: len(data) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", write_half)
        with pytest.raises(InputError, match=r"r\.h5 cannot be \(No space left on device\)"):
            save(full, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_limit_of_the_system_leaves_what_was_there(full, bare, tmp_path):
    """A real refusal by the operating system in the middle of the file; HDF5 writing itself would crash here."""
    resource = pytest.importorskip("resource")
    path = tmp_path / "r.h5"
    save(bare, path)
    before = path.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20000, hard))
    try:
        with pytest.raises(InputError, match="cannot be"):
            save(full, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_an_existing_result_is_replaced(full, bare, tmp_path):
    path = tmp_path / "r.h5"
    save(bare, path)
    save(full, path)
    assert list(differences(full, load(path))) == []
    shutil.copy(path, tmp_path / "copy.h5")
    assert list(differences(full, load(tmp_path / "copy.h5"))) == []


@pytest.fixture(scope="module")
def rig():
    """A tachometer, and a forced response beside the free one: fitted as it was sampled."""
    return identify(Run(n_periods=60, seed=1).record(), validate=False)


def test_what_was_measured_comes_back(rig, tmp_path):
    """Cycles and lifted responses are made again, to the last bit."""
    save(rig, tmp_path / "r.h5")
    back = load(tmp_path / "r.h5")
    assert list(differences(rig, back)) == []
    assert back.model is back.fit.model


@pytest.mark.slow
def test_it_is_the_same_to_the_last_digit_with_threads_in_blas(rig, tmp_path, monkeypatch):
    """Here, and not in a child, whose threads are those of its environment."""
    monkeypatch.setattr("floquid.store._files.GUARD._serving", True)
    with threadpool_limits(2, user_api="blas"):
        analysis = identify(rig.records, settings=rig.settings)
        save(analysis, tmp_path / "result.h5")
        assert list(differences(analysis, load(tmp_path / "result.h5"))) == []


@pytest.mark.slow
def test_the_angle_of_the_shaft_comes_back(tmp_path):
    """Of each record, with what it rests on: pulses, spline, its own deviations."""
    hits = [Run(n_periods=60, seed=seed).record() for seed in (1, 2)]
    found = identify(hits, validate=False)
    save(found, tmp_path / "r.h5")
    back = load(tmp_path / "r.h5")
    assert len(found.shafts) == 2
    assert list(differences(found.shafts, back.shafts)) == []
    for one, other, record in zip(found.shafts, back.shafts, hits, strict=True):
        assert np.array_equal(one.angle(record.times[100:-100]), other.angle(record.times[100:-100]))
        assert np.array_equal(one.angle_std(record.times[100:-100]), other.angle_std(record.times[100:-100]))


@pytest.mark.first(1)
@pytest.mark.parametrize("of", ["a tachometer", "gaps"])
def test_residues_that_were_left_free_are_a_fit_that_comes_back(of, tmp_path):
    """Out of step: the resampled response that the fit is of is in the file, beside what was measured."""
    record = Run(n_periods=60, seed=1, imbalance=0.0, wander=0.0).record()
    if of == "gaps":
        whole = ROTOR.simulate(n_periods=40, samples_per_period=8, noise=0.01)
        values = whole.values.copy()
        values[:, 100:104] = np.nan
        record = replace(whole, values=values)
    found = identify(record, constrained=False, validate=False)
    assert not found.constrained
    assert found.misfit is None
    assert len(found.shafts) == (of == "a tachometer")
    save(found, tmp_path / "r.h5")
    back = load(tmp_path / "r.h5")
    assert list(differences(found, back)) == []
    assert list(differences(found.records, (record,))) == []
    with h5py.File(tmp_path / "r.h5", "r+") as file:
        del file["decay/fit/free"]
    with pytest.raises(InputError, match=r"no whole|missing samples|constant period|whole number"):
        load(tmp_path / "r.h5")


def offset(record):
    """Beside a forced response."""
    return replace(record, values=record.values + 0.5)


def with_a_gap(record):
    values = record.values.copy()
    values[:, 100:104] = np.nan
    return replace(record, values=values)


def ringing(n_periods=80, seed=1, **options):
    return ROTOR.simulate(n_periods=n_periods, samples_per_period=8, noise=0.01, seed=seed, **options).select(
        ["X", "Y"]
    )


KINDS = {
    "an offset, the record begins within a period": (lambda: [offset(record) for record in two_hits()], {}),
    "gaps and an offset": (lambda: offset(with_a_gap(ringing())), {}),
    "gaps": (lambda: with_a_gap(ringing()), {}),
    "a rate out of step": (lambda: replace(ringing(), sample_rate=1.3), {}),
    "phases of their own": (lambda: [ringing(), replace(ringing(seed=2, impulse_deg=75.0), start=5.0).with_clock(
        ConstantPeriod(period=ROTOR.period, origin=5.3))], {}),
    "its own period": (ringing, {"estimate_period": True, "period": 1.002 * ROTOR.period}),
    "free residues, an offset": (lambda: offset(ringing()), {"constrained": False}),
    "free residues, gaps and an offset": (lambda: offset(with_a_gap(ringing())), {"constrained": False}),
}  # fmt: skip


@pytest.mark.first(2)
@pytest.mark.parametrize("kind", KINDS)
def test_a_result_of_every_kind_of_record_comes_back(kind, tmp_path):
    """To the last bit: fit, cycles, lifted responses; and the records are those that were given."""
    make, options = KINDS[kind]
    given = make()
    found = identify(given, validate=False, **options)
    save(found, tmp_path / "r.h5")
    assert list(differences(found, load(tmp_path / "r.h5"))) == []
    records = given if isinstance(given, list) else [given]
    assert [record.values.tobytes() for record in found.records] == [record.values.tobytes() for record in records]
    assert found.model is found.fit.model
    assert found.constrained == ("constrained" not in options)


def test_a_free_response_is_in_the_file_only_where_it_is_not_the_record(full, rig, tmp_path):
    for found, inside in ((full, False), (rig, True)):
        save(found, tmp_path / "r.h5")
        with h5py.File(tmp_path / "r.h5") as file:
            assert ("free" in file["decay/fit"]) == inside


def test_the_reasons_of_a_fit_come_back_where_the_order_was_given(rig, tmp_path):
    save(with_decay(rig, choice=None), tmp_path / "r.h5")
    back = load(tmp_path / "r.h5")
    assert back.choice is None
    assert back.fit.findings == rig.fit.findings != ()


@pytest.mark.parametrize(
    "clock",
    [
        AzimuthSignal(channel="tach", periods_per_revolution=0.5),
        PulseTimes(times=np.arange(80) * 6.0, pulses_per_revolution=3, periods_per_revolution=2.0),
    ],
    ids=["azimuth", "pulse times"],
)
def test_every_kind_of_clock_comes_back_and_an_orbit(rig, clock, tmp_path):
    orbit = np.random.default_rng(0).standard_normal((rig.records[0].n_channels, 7))
    record = replace(rig.records[0], clock=clock, orbit=orbit)
    changed = replace(rig, records=(record,))
    save(changed, tmp_path / "r.h5")
    back = load(tmp_path / "r.h5").records[0]
    assert list(differences(record, back)) == []


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("records/hit1/clock/kind", "Pendulum", "damaged or not whole: 'Pendulum'"),
        ("records/hit1/clock/channel", 3.0, "damaged"),
        ("decay/fit/free/hit1/values", np.zeros((4, 7)), "not the response that the records hold"),
        ("shafts", None, "damaged"),
    ],
)
def test_a_damaged_measured_record_is_refused_in_words(rig, tmp_path, name, value, words):
    save(rig, tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5", "r+") as file:
        del file[name]
        if value is not None:
            file[name] = value
    with pytest.raises(InputError, match=words):
        load(tmp_path / "r.h5")


def test_a_file_from_before_there_was_a_choice_of_branch_is_read(bare, tmp_path):
    save(bare, tmp_path / "r.h5")
    with h5py.File(tmp_path / "r.h5", "a") as file:
        del file["settings/branch"]
    assert list(differences(bare, load(tmp_path / "r.h5"))) == []
