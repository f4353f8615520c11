"""Other people's identifiers, and the one of the page «Bring your own identifier», beyond the laws of all."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from benchmarks.peers import adapters
from benchmarks.peers.adapters import BOPDMD, PyOMA2SSI, SdypyLSCF, _within, paired
from numpy.testing import assert_allclose
from tests.contracts.test_identifiers import DT, OTHERS, PACKAGES, PAGE, SETS, cells, farthest, present

import floquid
from floquid.errors import InputError
from floquid.lti import MaximumLikelihood, Outcome, TimeResponses

EXACT = 1e-10
"""How far a multiplier may be from the truth in responses without noise; all four reach a few 1e-15."""


EVERY = pytest.mark.parametrize("identifier", OTHERS.values(), ids=OTHERS)
SLOWEST = "BOPDMD"
STARTS = pytest.mark.parametrize(
    "identifier",
    [pytest.param(own, marks=pytest.mark.slow if name == SLOWEST else (), id=name) for name, own in OTHERS.items()],
)


@pytest.fixture(autouse=True)
def _skip_the_absent(request):
    parameters = request.node.callspec.params if hasattr(request.node, "callspec") else {}
    kind = type(parameters.get("identifier"))
    if not present(kind):
        pytest.skip(f"{PACKAGES[kind]} is not installed: it is in the dependency group `peers`")


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


def test_the_table_holds_every_adapter():
    assert {getattr(adapters, name) for name in adapters.__all__} == set(PACKAGES)
    assert set(PACKAGES) <= {type(identifier) for identifier in OTHERS.values()}


@EVERY
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_decays_decay(identifier, noise):
    """A common LSCF code turns damping round when the band starts at zero frequency."""
    full, data = decays([np.exp(-0.02 + 0.05j), np.exp(-0.05 + 2.5j), 0.97], noise=noise, outputs=20, samples=200)
    found = identified(identifier, data, len(full))
    assert np.abs(found.multipliers).max() < 1.0
    assert farthest(found.multipliers, full) < (0.02 if noise else EXACT)


@EVERY
def test_none_is_refused(identifier):
    """By the page's own with words of its own."""
    state, name = identifier.prepare(decays(SETS["pair"])[1]), type(identifier).__name__
    ours = rf"`order` of `{name}\.extract` must .+, but is None\.\n.*MaximumLikelihood\(initial={name}\(\)\)"
    with pytest.raises(InputError, match=ours if name != "MatrixPencil" else "`MatrixPencil` needs an order of 1 to"):
        identifier.extract(state)


@EVERY
def test_a_mode_that_the_shorter_input_alone_excites_is_found(identifier):
    full, data = decays(SETS["two pairs"])
    one = decays(SETS["pair"], inputs=1)[1]
    both = np.concatenate([one.values, data.values[:, :1]], axis=1)
    noise = np.concatenate([one.noise, data.noise[:, :1]], axis=1)
    found = identified(identifier, TimeResponses(values=both, dt=DT, noise=noise, lengths=[80, 50]), 4)
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


@pytest.mark.parametrize("identifier", [kind() for kind in PACKAGES], ids=lambda i: type(i).__name__)
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


@pytest.mark.parametrize(("kind", "module"), PACKAGES.items(), ids=lambda k: getattr(k, "__name__", k))
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
@pytest.mark.skipif(not all(map(present, PACKAGES)), reason="needs all three packages")
def test_packages_are_loaded_when_used_and_leave_no_trace():
    """No progress bar, no log, no warning, and numpy's own settings as they were."""
    run = subprocess.run([sys.executable, "-c", USED], capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")


@pytest.mark.slow
@pytest.mark.skipif(not all(map(present, PACKAGES)), reason="needs all three packages")
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
