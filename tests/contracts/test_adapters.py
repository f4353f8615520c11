"""Other people's identifiers, and the one of the page «Bring your own identifier», through the laws of ours."""

import copy
import dataclasses
import subprocess
import sys
import typing
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from benchmarks.peers import adapters
from benchmarks.peers.adapters import BOPDMD, PyOMA2SSI, SdypyLSCF, _within, paired
from markdown_it import MarkdownIt
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import linear_sum_assignment

import floquid
from floquid.errors import InputError
from floquid.lti import AbstractIdentifier, MaximumLikelihood, ModalModel, Outcome, TimeResponses

PAGE = Path(__file__).parents[2] / "docs" / "own_identifier.md"

EXACT = 1e-10
"""How far a multiplier may be from the truth in responses without noise; all four reach a few 1e-15."""


def cells(page):
    """The visible code cells of a page that the build executes."""
    tokens = MarkdownIt("commonmark").parse(page.read_text(encoding="utf-8"))
    return [t.content for t in tokens if t.type == "fence" and t.info == "{code-cell} python" and t.content[0] != ":"]


def matrix_pencil():
    """The identifier that the page defines in its first cell."""
    names = {"__name__": "page"}
    exec(cells(PAGE)[0], names)
    return names["MatrixPencil"]


PEERS = {BOPDMD: "pydmd", SdypyLSCF: "sdypy.EMA", PyOMA2SSI: "pyoma2.functions.ssi"}
TABLE = {
    "BOPDMD": BOPDMD(),
    "SdypyLSCF": SdypyLSCF(),
    "PyOMA2SSI, cov": PyOMA2SSI(),
    "PyOMA2SSI, dat": PyOMA2SSI(method="dat"),
    "of the page": matrix_pencil()(),
}
EVERY = pytest.mark.parametrize("identifier", TABLE.values(), ids=TABLE)
SLOWEST = "BOPDMD"
STARTS = pytest.mark.parametrize(
    "identifier",
    [pytest.param(own, marks=pytest.mark.slow if name == SLOWEST else (), id=name) for name, own in TABLE.items()],
)

DT = 0.25
SETS = {
    "pair": [np.exp(-0.02 + 1.0j)],
    "two pairs": [np.exp(-0.02 + 1.0j), np.exp(-0.05 + 2.5j)],
    "positive": [0.95],
    "negative": [-0.9],
    "mixed": [np.exp(-0.02 + 1.0j), 0.95, -0.9],
}
EVERY_SET = pytest.mark.parametrize("multipliers", SETS.values(), ids=SETS)


def present(kind):
    """Whether its package is there, found without importing it."""
    return kind not in PEERS or find_spec(PEERS[kind].split(".")[0]) is not None


@pytest.fixture(autouse=True)
def _skip_the_absent(request):
    parameters = request.node.callspec.params if hasattr(request.node, "callspec") else {}
    kind = type(parameters.get("identifier"))
    if not present(kind):
        pytest.skip(f"{PEERS[kind]} is not installed: it is in the dependency group `peers`")


def decays(multipliers, *, outputs=5, inputs=2, samples=80, noise=0.0, seed=0):
    """The multipliers with their conjugates, and responses with noise of a share of each one's largest value."""
    generator = np.random.default_rng(seed)
    full, residues = [], []
    for mu in multipliers:
        residue = generator.standard_normal((outputs, inputs)) + 1j * generator.standard_normal((outputs, inputs))
        full += [mu, np.conj(mu)] if np.imag(mu) else [mu]
        residues += [residue, residue.conj()] if np.imag(mu) else [residue.real]
    full = np.array(full, complex)
    values = np.einsum("roi,rk->oik", np.array(residues, complex), full[:, None] ** np.arange(samples)).real
    largest = np.abs(values).max(axis=2)
    values = values + noise * largest[..., None] * generator.standard_normal(values.shape)
    return full, TimeResponses(values=values, dt=DT, noise=max(noise, 1e-10) * largest)


def identified(identifier, data, order):
    return identifier.extract(identifier.prepare(data), order)


def farthest(found, expected):
    """The largest distance when multipliers are paired so that the sum of distances is least."""
    assert len(found) == len(expected)
    distance = np.abs(np.subtract.outer(found, expected))
    return distance[linear_sum_assignment(distance)].max()


def test_the_table_holds_every_adapter():
    assert {getattr(adapters, name) for name in adapters.__all__} == set(PEERS)
    assert set(PEERS) <= {type(identifier) for identifier in TABLE.values()}


@EVERY
def test_it_is_a_final_frozen_object_with_its_options_as_fields(identifier):
    kind = type(identifier)
    assert kind.__bases__ == (AbstractIdentifier,)
    assert getattr(kind, "__final__", False), "mark it @typing.final"
    assert typing.get_type_hints(kind)
    assert dataclasses.fields(identifier)
    for field in dataclasses.fields(identifier):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(identifier, field.name, None)
    assert dataclasses.replace(identifier) == identifier
    assert not hasattr(identifier, "__dict__")
    assert not kind.decides


@EVERY
@EVERY_SET
def test_exact_decays_are_recovered_and_given_back(identifier, multipliers):
    full, data = decays(multipliers)
    found = identified(identifier, data, len(full))
    assert isinstance(found, ModalModel)
    assert (found.outcome, found.dt) == (Outcome.SUCCESS, DT)
    assert farthest(found.multipliers, full) < EXACT
    back = np.einsum("roi,rk->oik", found.residues, found.multipliers[:, None] ** np.arange(80))
    assert_allclose(back, data.values, atol=1e-9)


@EVERY
@EVERY_SET
def test_conjugates_are_neighbours_and_have_conjugate_residues(identifier, multipliers):
    full, data = decays(multipliers, noise=0.01)
    found = identified(identifier, data, len(full))
    index = 0
    while index < found.order:
        if found.multipliers[index].imag == 0.0:
            assert_array_equal(found.residues[index].imag, 0.0)
            index += 1
        else:
            assert found.multipliers[index + 1] == found.multipliers[index].conj()
            assert_array_equal(found.residues[index + 1], found.residues[index].conj())
            index += 2


@EVERY
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_decays_decay(identifier, noise):
    """A common LSCF code turns damping round when the band starts at zero frequency."""
    full, data = decays([np.exp(-0.02 + 0.05j), np.exp(-0.05 + 2.5j), 0.97], noise=noise, outputs=20, samples=200)
    found = identified(identifier, data, len(full))
    assert np.abs(found.multipliers).max() < 1.0
    assert farthest(found.multipliers, full) < (0.02 if noise else EXACT)


@EVERY
@pytest.mark.parametrize("modes", [1, 2, 5])
def test_an_order_that_the_data_hold_is_reached(identifier, modes):
    full, data = decays(np.exp(-0.03 + 1j * np.linspace(0.3, 2.8, modes)), outputs=12, samples=120, noise=1e-3)
    found = identified(identifier, data, 2 * modes)
    assert (found.order, found.outcome) == (2 * modes, Outcome.SUCCESS)
    assert farthest(found.multipliers, full) < 0.01


@pytest.mark.parametrize("identifier", [i for i in TABLE.values() if type(i) in PEERS], ids=list(TABLE)[:-1])
@pytest.mark.parametrize("order", range(1, 6))
def test_the_outcome_says_whether_the_order_was_reached(identifier, order):
    found = identified(identifier, decays(SETS["pair"])[1], order)
    assert (found.outcome is Outcome.SUCCESS) == (found.order == order)


@EVERY
def test_none_is_refused(identifier):
    """By the page's own with words of its own."""
    state, name = identifier.prepare(decays(SETS["pair"])[1]), type(identifier).__name__
    ours = rf"`order` of `{name}\.extract` must .+, but is None\.\n.*MaximumLikelihood\(initial={name}\(\)\)"
    with pytest.raises(InputError, match=ours if name != "MatrixPencil" else "`MatrixPencil` needs an order of 1 to"):
        identifier.extract(state)


@pytest.mark.parametrize("identifier", [kind() for kind in PEERS], ids=lambda i: type(i).__name__)
@pytest.mark.parametrize("wrong", [0, -2, 80, 2.0, True, "2"])
def test_an_order_that_is_no_order_is_refused(identifier, wrong):
    state = identifier.prepare(decays(SETS["pair"])[1])
    with pytest.raises(InputError, match=r"^Argument `order` of `\w+\.extract` must .+, but is "):
        identifier.extract(state, wrong)


@EVERY
def test_extracting_is_repeatable_and_leaves_the_data_alone(identifier):
    data = decays(SETS["mixed"], noise=0.01)[1]
    before = copy.deepcopy(data.values)
    state = identifier.prepare(data)
    first = identifier.extract(state, 4)
    identifier.extract(state, 2)
    again = identifier.extract(state, 4)
    assert_array_equal(first.multipliers, again.multipliers)
    assert_array_equal(first.residues, again.residues)
    assert_array_equal(data.values, before)


@EVERY
def test_units_of_the_responses_do_not_matter(identifier):
    data = decays(SETS["two pairs"], noise=0.01)[1]
    factor = 10.0 ** np.random.default_rng(1).uniform(-6, 6, data.noise.shape)
    scaled = TimeResponses(values=data.values * factor[..., None], dt=data.dt, noise=data.noise * factor)
    found, other = identified(identifier, data, 4), identified(identifier, scaled, 4)
    assert farthest(found.multipliers, other.multipliers) < 1e-8
    powers = other.multipliers[:, None] ** np.arange(80)
    model, back = (np.einsum("roi,rk->oik", m.residues, powers).real for m in (found, other))
    assert_allclose(back / factor[..., None], model, atol=1e-6)


@EVERY
def test_the_unit_of_time_does_not_matter(identifier):
    data = decays(SETS["two pairs"], noise=0.01)[1]
    slow = TimeResponses(values=data.values, dt=8.0 * DT, noise=data.noise)
    assert_allclose(identified(identifier, slow, 4).poles, identified(identifier, data, 4).poles / 8.0, rtol=1e-12)


@EVERY
def test_the_order_of_the_responses_does_not_matter(identifier):
    data = decays(SETS["mixed"], noise=0.01)[1]
    turned = TimeResponses(values=data.values[::-1, ::-1], dt=DT, noise=data.noise[::-1, ::-1])
    assert farthest(identified(identifier, data, 4).multipliers, identified(identifier, turned, 4).multipliers) < 1e-8


@EVERY
@pytest.mark.parametrize("lengths", [(80, 80), (80, 37), (20, 80)])
def test_samples_beyond_an_inputs_length_are_not_looked_at(identifier, lengths):
    full, data = decays(SETS["two pairs"])
    values = np.array(data.values)
    for hit, length in enumerate(lengths):
        values[:, hit, length:] = 1e3
    found = identified(identifier, TimeResponses(values=values, dt=DT, noise=data.noise, lengths=lengths), 4)
    assert farthest(found.multipliers, full) < EXACT


@EVERY
def test_a_mode_that_the_shorter_input_alone_excites_is_found(identifier):
    full, data = decays(SETS["two pairs"])
    one = decays(SETS["pair"], inputs=1)[1]
    both = np.concatenate([one.values, data.values[:, :1]], axis=1)
    noise = np.concatenate([one.noise, data.noise[:, :1]], axis=1)
    found = identified(identifier, TimeResponses(values=both, dt=DT, noise=noise, lengths=[80, 50]), 4)
    assert farthest(found.multipliers, full) < EXACT


@EVERY
@pytest.mark.parametrize(
    ("outputs", "inputs", "samples"), [(1, 1, 80), (1, 3, 41), (3, 1, 6), (50, 1, 7), (100, 4, 12), (2, 1, 1000)]
)
def test_every_shape_of_data(identifier, outputs, inputs, samples):
    full, data = decays(SETS["pair"], outputs=outputs, inputs=inputs, samples=samples)
    found = identified(identifier, data, 2)
    assert found.residues.shape == (2, outputs, inputs)
    assert farthest(found.multipliers, full) < EXACT


@pytest.mark.parametrize("identifier", [BOPDMD(), SdypyLSCF(), PyOMA2SSI()], ids=lambda i: type(i).__name__)
def test_one_output_holds_more_poles_than_outputs(identifier):
    full, data = decays(SETS["mixed"], outputs=1, inputs=1)
    assert farthest(identified(identifier, data, 4).multipliers, full) < 1e-8


def test_lscf_finds_a_negative_multiplier_among_real_ones():
    """A denominator with real roots only: the package takes the real logarithm of a negative number."""
    pytest.importorskip("sdypy", reason="it is in the dependency group `peers`")
    full, data = decays(SETS["negative"])
    assert farthest(identified(SdypyLSCF(pairs=1), data, 1).multipliers, full) < EXACT


def test_too_few_samples_for_a_hankel_matrix_is_an_outcome():
    pytest.importorskip("pyoma2", reason="it is in the dependency group `peers`")
    data = decays(SETS["pair"], outputs=1, inputs=1, samples=6)[1]
    found = identified(PyOMA2SSI(), data, 2)
    assert (found.order, found.outcome) == (0, Outcome.TOO_FEW_SAMPLES)


@STARTS
def test_maximum_likelihood_starts_from_it(identifier):
    data = decays(SETS["two pairs"], noise=0.02)[1]
    best = identified(MaximumLikelihood(), data, 4)
    found = identified(MaximumLikelihood(initial=identifier), data, 4)
    assert farthest(found.multipliers, best.multipliers) < 1e-6
    assert found.covariance is not None


@EVERY
def test_refining_gives_a_model_of_the_same_order(identifier):
    data = decays(SETS["mixed"], noise=0.01)[1]
    state = identifier.prepare(data)
    model = identifier.extract(state, 4)
    assert farthest(identifier.refine(state, model).multipliers, model.multipliers) < 1e-6


def test_bopdmd_refines_from_the_poles_it_is_given():
    """Two records of one system: the poles of the first start the fit of the second, in few iterations."""
    pytest.importorskip("pydmd", reason="it is in the dependency group `peers`")
    one, other = (decays(SETS["two pairs"], noise=0.02, seed=0)[1] for _ in range(2))
    quick, slow = BOPDMD(iterations=3), BOPDMD()
    best = identified(slow, one, 4)
    assert farthest(quick.refine(quick.prepare(other), best).multipliers, best.multipliers) < 1e-6
    away = dataclasses.replace(best, multipliers=best.multipliers * 0.7)
    assert farthest(quick.refine(quick.prepare(other), away).multipliers, best.multipliers) > 1e-6


def test_bopdmd_is_maximum_likelihood_where_it_converges():
    """Variable projection on as many components as poles leaves what the best poles leave, to a share of the noise."""
    pytest.importorskip("pydmd", reason="it is in the dependency group `peers`")
    data = decays(SETS["two pairs"], outputs=30, inputs=1, samples=200, noise=0.02)[1]
    best = identified(MaximumLikelihood(), data, 4)
    std = np.sqrt(np.diag(best.covariance)).max() * DT
    assert farthest(identified(BOPDMD(), data, 4).multipliers, best.multipliers) < 0.5 * std


@pytest.mark.parametrize("identifier", [kind() for kind in PEERS], ids=lambda i: type(i).__name__)
def test_noise_gives_poles_that_can_be_computed_with(identifier):
    """Twelve poles where there is none."""
    values = np.random.default_rng(0).standard_normal((10, 1, 200))
    found = identified(identifier, TimeResponses(values=values, dt=1.0), 12)
    assert np.isfinite(found.residues).all()
    assert np.abs(found.multipliers).max() < np.exp(600 / 200 + 1e-9)


def test_bopdmd_is_kept_from_infinite_numbers():
    """Growth that overflows in the fit meets a least-squares routine of LAPACK that may never return."""
    constrained = _within(100)(np.array([9.2 + 32.7j, 9.2 - 32.7j, -8.0 + 0.0j]))
    assert_allclose(constrained.real, [2.0, 2.0, -3.0])
    assert_allclose(constrained.imag, np.array([1.0, -1.0, 0.0]) * (32.7 - 10 * np.pi), atol=1e-12)
    slow = _within(6000)(np.array([1.0 + 0.0j])).real[0]
    assert slow == pytest.approx(0.06, rel=0.1)
    assert np.isfinite(np.exp(2 * 6000 * slow)), "squares are, too"
    with pytest.raises(np.linalg.LinAlgError, match="not finite"):
        _within(300)(np.array([np.nan + 0.0j]))


def test_the_method_of_ssi_is_one_of_two():
    with pytest.raises(InputError, match='`method` of `PyOMA2SSI` must be "cov" or "dat", but is'):
        PyOMA2SSI(method="pca")


@pytest.mark.parametrize(("kind", "module"), PEERS.items(), ids=lambda k: getattr(k, "__name__", k))
def test_an_absent_package_is_named(kind, module, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    name = {"pydmd": "pydmd", "sdypy.EMA": "sdypy-EMA", "pyoma2.functions.ssi": "pyOMA_2"}[module]
    with pytest.raises(InputError, match=rf"`{kind.__name__}` .* {name}, which .*\n  Install it: pip install {name}$"):
        kind().prepare(decays(SETS["pair"])[1])


USED = """
import sys
import numpy as np
from benchmarks.peers import adapters
from floquid.lti import TimeResponses
PEERS = {"pydmd", "sdypy", "pyoma2"}
assert not PEERS & set(sys.modules), "loaded with floquid"
before = np.geterr()
values = np.exp(-0.02 * np.arange(60)) * np.cos(np.arange(60) + np.arange(3)[:, None])
data = TimeResponses(values=values[:, None], dt=1.0, noise=np.full((3, 1), 1e-6))
for kind in (adapters.BOPDMD, adapters.SdypyLSCF, adapters.PyOMA2SSI):
    identifier = kind()
    assert identifier.extract(identifier.prepare(data), 2).order == 2
assert PEERS <= set(sys.modules)
assert np.geterr() == before, "numpy's handling of errors was changed"
"""


@pytest.mark.slow
@pytest.mark.skipif(not all(map(present, PEERS)), reason="needs all three packages")
def test_packages_are_loaded_when_used_and_leave_no_trace():
    """No progress bar, no log, no warning, and numpy's own settings as they were."""
    run = subprocess.run([sys.executable, "-c", USED], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")


@pytest.mark.slow
@pytest.mark.skipif(not all(map(present, PEERS)), reason="needs all three packages")
def test_the_cells_of_the_page_run(capsys):
    names = {"fq": floquid}
    for cell in cells(PAGE):
        exec(cell, names)
    errors = [float(line.split()[0]) for line in capsys.readouterr().out.splitlines()]
    assert len(errors) == 6
    assert max(errors) < 1e-4
    assert_allclose(errors[1], errors[2], rtol=0.1)


def test_pairing_leaves_conjugates_and_real_multipliers_alone():
    logs = np.log(np.array([0.9 * np.exp(2j), 0.95, 0.9 * np.exp(-2j), -0.8, 0.7]) + 0j)
    assert_allclose(np.exp(paired(logs)), np.exp(logs), atol=1e-15)


def test_pairing_puts_strays_right():
    s = np.array([-0.1 + 1.0j, -0.3 - 1.1j, -0.2 + 3.1j, -0.05 + 0.1j])
    expected = np.array([-0.2 + 1.05j, -0.2 - 1.05j, -0.2 + 1j * np.pi, -0.05])
    assert_allclose(paired(s), expected, atol=1e-15)
