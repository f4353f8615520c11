"""A sensor that runs to and fro over a structure: its frequencies, its shapes over the path, and on to pycsldv."""

from dataclasses import replace

import numpy as np
import pytest
from tests.driven import transfer_functions

import floquid as fq
from floquid.core import PeriodicModel, on_branch, turning_point, unevenness
from floquid.errors import InputError
from floquid.findings import note
from floquid.fit import chi2_limit
from floquid.pipeline._identify import _named
from floquid.shapes import path_shapes
from floquid.views import branch_of, mode_notes

PERIOD, PHASES, PHI = 0.1, 32, 0.7
TURNS, DAMPING = np.array([1.37, 4.42]), np.array([0.012, 0.004])
SIZE = 2.0 * np.pi / PERIOD * TURNS
TRUE = -DAMPING * SIZE + 1j * SIZE * np.sqrt(1.0 - DAMPING**2)
X = np.linspace(-1.0, 1.0, 41)


def shapes_at(x):
    """Bending of a strip held at its ends, which the sensor does not reach (modes, positions)."""
    return np.sin(np.pi * np.multiply.outer([1, 3], 0.45 + 0.3 * np.asarray(x)))


def scanned(x, rate, seed):
    """The rate of the free response under the sensor at x, with 5 % of noise."""
    times = np.arange(len(x)) / rate
    clean = np.einsum("rn,rn->n", shapes_at(x), np.exp(np.multiply.outer(TRUE, times)) * np.array([[1.0], [0.8j]]))
    noise = 0.05 * clean.real.std() * np.random.default_rng(seed).standard_normal(len(x))
    return fq.Record(values=[clean.real + noise], sample_rate=rate, channels=[fq.Channel(name="v", unit="m/s")])


@pytest.fixture(scope="module")
def record():
    times = PERIOD / PHASES * np.arange(50 * PHASES)
    return scanned(np.cos(2.0 * np.pi * times / PERIOD + PHI), PHASES / PERIOD, 0)


@pytest.fixture(scope="module")
def model(record, tmp_path_factory):
    """From a file and to a file, as a user would."""
    folder = tmp_path_factory.mktemp("scan")
    fq.write(record, folder / "scan.h5")
    found = fq.identify(fq.read(folder / "scan.h5", period=PERIOD))
    assert found.passed
    fq.save(found, folder / "result.h5")
    return fq.load(folder / "result.h5").model


def mac(one, two):
    return abs(np.vdot(one, two)) ** 2 / (np.vdot(one, one) * np.vdot(two, two)).real


def by_truth(found):
    return [int(np.abs(found.exponents - one).argmin()) for one in TRUE]


def test_the_strongest_line_is_not_the_structure_s_and_the_symmetric_branch_is(model):
    assert np.abs(np.subtract.outer(model.exponents, TRUE)).min(axis=0).max() > 0.4 * model.fundamental
    found = path_shapes(model)
    assert found.phase == pytest.approx(PHI, abs=0.01)
    off, std = found.exponents[by_truth(found)] - TRUE, found.exponent_std[by_truth(found)]
    assert np.abs([off.real / std.real, off.imag / std.imag]).max() < 4.0


def test_shapes_over_the_path_are_those_of_the_structure(model):
    found = path_shapes(model)
    for mode, true in zip(by_truth(found), shapes_at(X), strict=True):
        assert mac(found.at(X)[mode, 0], true) > 0.99
    fitted = np.polynomial.chebyshev.chebfit(X, shapes_at(X).T, found.coefficients.shape[2] - 1).T
    for mode, true in zip(by_truth(found), fitted, strict=True):
        mine, std = found.coefficients[mode, 0], found.std[mode, 0]
        off = mine - true * np.vdot(true, mine) / np.vdot(true, true)  # its factor is free
        kept = np.abs(mine) > 0.0
        assert np.abs([off.real[kept] / std.real[kept], off.imag[kept] / std.imag[kept]]).max() < 4.0


def test_on_to_pycsldv_and_back(model, record):
    """Its shapes by our poles are the structure's and ours; ours of a scan that it laid out are the structure's."""
    pycsldv = pytest.importorskip("pycsldv")
    found = path_shapes(model)
    poles = found.exponents[by_truth(found)]
    series = pycsldv.demodulate_ods_1d(
        record.values[0], record.sample_rate, fx=1.0 / PERIOD, poles=poles, order=8, phi_x=found.phase
    )
    for mode, peer, true in zip(by_truth(found), series, shapes_at(X), strict=True):
        theirs = np.polynomial.chebyshev.chebval(X, peer)
        assert mac(theirs, true) > 0.99
        assert mac(theirs, found.at(X)[mode, 0]) > 0.99
    _, path = pycsldv.sinusoidal_scan(1.0 / PERIOD, 50 * PHASES, PHASES / PERIOD)
    back = path_shapes(fq.identify(scanned(path, PHASES / PERIOD, 1), period=PERIOD, order=4, validate=False))
    assert back.phase == pytest.approx(0.0, abs=0.01)
    for mode, true in zip(by_truth(back), shapes_at(X), strict=True):
        assert mac(back.at(X)[mode, 0], true) > 0.99


def of_unknown_period(model):
    """The model with an error of the period that goes with all others."""
    parts = len(model.estimates.covariance)
    root = 0.01 * np.random.default_rng(2).standard_normal((parts, parts))
    own = replace(model.estimates, covariance=root @ root.T)
    to = np.zeros((2 * model.order, parts))
    for mode, exponent in enumerate(model.exponents):
        slopes = own.exponent_slopes[np.abs(own.exponents.imag - abs(exponent.imag)).argmin()]
        to[[mode, model.order + mode]] = slopes.real, np.sign(exponent.imag) * slopes.imag
    return replace(model, covariance=to @ own.covariance @ to.T, estimates=own, unselected=own)


@pytest.mark.parametrize("branch", ["slowest", "symmetric"])
def test_another_branch_is_the_same_response_with_the_same_deviations(model, branch):
    model = of_unknown_period(model)
    moved, times = on_branch(model, branch), np.linspace(0.0, 1.0, 50)
    assert not np.allclose(moved.exponents, model.exponents)
    np.testing.assert_allclose(moved.response(times), model.response(times), atol=1e-12)
    np.testing.assert_allclose(moved.multipliers, model.multipliers, rtol=1e-12)
    for one, two in ((moved.estimates, model.estimates), (moved.unselected, model.unselected)):
        lines = [np.argsort(np.abs(own.rates.imag)) for own in (one, two)]
        rates = [
            np.sqrt(np.einsum("kp,pq,kq->k", own.rate_slopes.imag, own.covariance, own.rate_slopes.imag))[order]
            for own, order in zip((one, two), lines, strict=True)
        ]
        np.testing.assert_allclose(*rates, rtol=1e-9)
        assert (one.exponents.imag > 0.0).all()
        std = [own.std()[order] for own, order in zip((one, two), lines, strict=True)]
        np.testing.assert_allclose(*std, rtol=1e-9)
    # Deviations of exponents include the error of the period that comes with the branch.
    slopes = moved.estimates.exponent_slopes.imag
    expected = np.sqrt(np.einsum("kp,pq,kq->k", slopes, moved.estimates.covariance, slopes))
    np.testing.assert_allclose(moved.exponent_std.imag[list(moved.upper_modes)], expected, rtol=1e-9)


def test_the_slowest_branch_is_within_half_a_fundamental(model):
    assert (np.abs(on_branch(model, "slowest").exponents.imag) <= 0.5 * model.fundamental).all()


def test_identify_takes_the_rule(record):
    options = {"period": PERIOD, "order": 4, "validate": False}
    found, usual = (fq.identify(record, branch=word, **options) for word in ("slowest", "strongest"))
    np.testing.assert_allclose(found.model.exponents, on_branch(usual.model, "slowest").exponents)
    # Another line that is nearly as strong makes the strongest a choice, and no other rule.
    notes = [[word for mode in own.model.upper_modes for word in mode_notes(own, mode)] for own in (found, usual)]
    assert notes == [[], ["f?"]]
    assert [branch_of(own) for own in (found, usual)] == ["slowest", "strongest"]


def test_findings_name_modes_as_the_table_does_however_a_frequency_was_rounded(record):
    found = fq.identify(record, period=PERIOD, order=4, validate=False)
    one = float(np.nextafter(found.model.frequencies_hz[0], np.inf))
    slow = on_branch(found.model, "slowest")
    for code, numbers in (
        ("all_needed", {"frequency": one}),
        ("product", {"frequency": one, "of": (one, one)}),
        ("double", {"first": one, "second": one}),
        ("undetermined", {"frequencies": (one,)}),
    ):
        (named,) = _named(replace(found, findings=(note(code, **numbers),)), slow).findings
        assert set(np.concatenate([np.ravel(own) for own in named.numbers.values()])) == {slow.frequencies_hz[0]}


def test_shapes_that_are_even_nowhere_are_refused():
    """A shape of two or four equal lines side by side has no line in its middle."""
    for lines, odd in (([0.0, 0.0, 1.0, 1.0, 0.0], 50), ([0.0, 1.0, 1.0, 1.0, 1.0], 25)):
        shape = np.array([[[lines]], [[lines[::-1]]]])
        model = PeriodicModel(
            exponents=[-1 + 9j, -1 - 9j], coefficients=shape, harmonics=range(-2, 3), period=1.0, channels=["v"]
        )
        with pytest.raises(InputError, match=rf"{odd} % of the energy of that at 1\.44121 Hz is odd"):
            turning_point(model)
    with pytest.raises(InputError, match=r"25 % of the energy of that at"):
        turning_point(model)
    with pytest.raises(InputError, match="sensor that runs to and fro"):
        path_shapes(model)


@pytest.mark.slow
def test_a_scan_over_the_middle_keeps_its_period():
    """Modes of a symmetric strip are even or odd over the middle: the response has lines two harmonics apart."""
    times = PERIOD / PHASES * np.arange(50 * PHASES)
    x = np.cos(2.0 * np.pi * times / PERIOD)
    shapes = np.sin(np.pi * np.multiply.outer([1, 2], 0.5 + 0.3 * x))
    clean = np.einsum("rn,rn->n", shapes, np.exp(np.multiply.outer(TRUE, times))).real
    noise = 0.02 * clean.std() * np.random.default_rng(5).standard_normal(len(times))
    record = fq.Record(values=[clean + noise], sample_rate=PHASES / PERIOD, channels=["v"])
    usual, even = (
        fq.identify(record, period=PERIOD, order=4, validate=False, branch=word) for word in ("strongest", "symmetric")
    )
    assert [own.code for own in usual.findings].count("period_multiple") == 1
    assert "period_multiple" not in [own.code for own in even.findings]
    found = path_shapes(even)
    off, std = found.exponents[by_truth(found)] - TRUE, found.exponent_std[by_truth(found)]
    assert np.abs([off.real / std.real, off.imag / std.imag]).max() < 4.0


def test_a_result_without_a_turning_point_stays_on_the_strongest_branch():
    """What was found is not lost where the shape has two equal lines side by side."""
    times = np.arange(1600) / 32.0
    clean = np.exp((-0.05 + 2j) * times) * (1.0 + np.exp(2j * np.pi * times))
    noise = 1e-3 * np.random.default_rng(4).standard_normal(len(times))
    record = fq.Record(values=[clean.real + noise], sample_rate=32.0, channels=["v"])
    left, usual = (fq.identify(record, period=1.0, validate=False, branch=word) for word in ("symmetric", "strongest"))
    np.testing.assert_array_equal(left.model.exponents, usual.model.exponents)
    (told,) = (own for own in left.findings if own.code == "branch_left")
    assert "50 % of the energy of that at" in str(told)
    assert branch_of(left) == "strongest"


SHAKEN = 2.0 * np.pi / PERIOD * 2.62 * (-0.01 + 1j)  # of the third bending mode, seen best on another line


def shaken(kind):
    """A scan of one mode under random excitation, measured or not, that begins within a period and rings at first."""
    options = {"inputs": {"inputs": ["F"]}, "ambient": {"excitation": "ambient"}}[kind]
    count = {"inputs": 30, "ambient": 80}[kind] * PHASES // 2
    step, rng = 2.0 * PERIOD / PHASES, np.random.default_rng(0)
    times, force = 0.53 + step * np.arange(count), rng.standard_normal(count)
    state, ahead = np.full(count, 0.02 + 0j), np.exp(SHAKEN * step)
    for k in range(count - 1):
        state[k + 1] = ahead * state[k] + (ahead - 1.0) / SHAKEN * force[k]
    clean = (shapes_at(np.cos(2.0 * np.pi * times / PERIOD + PHI))[1] * state).real
    values = np.array([clean + 0.02 * clean.std() * rng.standard_normal(count), force])[: 1 + (kind == "inputs")]
    record = fq.Record(values=values, sample_rate=1.0 / step, channels=["v", "F"][: len(values)], start=times[0])
    return record, {"period": PERIOD, "order": 2, "validate": False, **options}


@pytest.mark.first(1)
@pytest.mark.parametrize("kind", ["inputs", "ambient"])
def test_a_scan_of_what_goes_on_has_the_structure_s_exponent_too(kind):
    record, options = shaken(kind)
    found = fq.identify(record, branch="symmetric", **options)
    assert not any(own.code.startswith("branch") for own in found.findings)
    mode = int(np.abs(found.model.exponents - SHAKEN).argmin())
    off, std = found.model.exponents[mode] - SHAKEN, found.model.exponent_std[mode]
    assert np.abs([off.real / std.real, off.imag / std.imag]).max() < 4.0
    assert mac(path_shapes(found).at(X)[0, 0], shapes_at(X)[1]) > 0.99
    slow = on_branch(found.model, "slowest")
    assert abs(slow.exponents[mode].imag) < 0.5 * slow.fundamental < abs(found.model.exponents[mode].imag)


def test_of_measured_inputs_nothing_else_depends_on_the_branch(tmp_path):
    """The transfer functions, the state at first and the deviations of gains are those of the strongest branch."""
    record, options = shaken("inputs")
    usual, even = (fq.identify(record, branch=word, **options) for word in ("strongest", "symmetric"))
    one, two = usual.model, even.model
    assert one.inputs.begins == pytest.approx([0.03])
    np.testing.assert_allclose(one.multipliers, two.multipliers, rtol=1e-9)
    turned = np.rint((two.exponents - one.exponents).imag / one.fundamental)
    assert turned.any()
    hertz = [3.0, 20.0, 25.0]
    sides = [transfer_functions(own, hertz, (-2, -1, 0, 1, 2)).values for own in (one, two)]
    np.testing.assert_allclose(*sides, rtol=1e-9, atol=1e-12 * np.abs(sides[0]).max())
    np.testing.assert_allclose(*(own.transfer(hertz).std for own in (usual, even)), rtol=1e-12)
    first = [np.einsum("rc,rk->c", own.shapes(0.03)[:, :, 0, 0], own.inputs.initial) for own in (one, two)]
    np.testing.assert_allclose(*first, rtol=1e-9)
    below = on_branch(one, "slowest")  # where the other half of the pair is above the axis
    assert below.exponents[below.modes_of(below.estimates)[0]] != below.exponents[one.modes_of(one.estimates)[0]]
    for moved in (two, below):
        for own in (moved.estimates, moved.unselected):  # which name the pair by its upper half alone
            values = moved.inputs.coefficients[moved.modes_of(own)[0]]
            lines = np.isin(moved.inputs.harmonics, own.gains.harmonics)
            np.testing.assert_allclose(values[:, lines], own.gains.coefficients[0], atol=1e-3)
    std = [np.sort_complex(own.gains.std(own.covariance).ravel()) for own in (one.estimates, two.estimates)]
    np.testing.assert_allclose(*std, rtol=1e-9)
    fq.save(even, tmp_path / "result.h5")
    again = fq.load(tmp_path / "result.h5")
    np.testing.assert_array_equal(again.model.inputs.begins, two.inputs.begins)


def test_shapes_that_are_no_mirror_images_are_told(model):
    """Noise makes what is told of a scan χ²; of a shape with one line stronger than its image it is far off."""
    squares, degrees = unevenness(on_branch(model, "symmetric"))
    assert 0.3 * degrees < squares < chi2_limit(degrees, 1e-3)
    rotor = fq.systems.JeffcottRotor()
    record = rotor.simulate(n_periods=60, samples_per_period=16, noise=0.01, seed=0)
    times = np.arange(1600) / 32.0
    lines = np.exp(np.multiply.outer((-0.05 + 2j) + 2j * np.pi * np.arange(-1, 2), times))
    clean = (np.array([0.10, 1.0, 0.12]) @ lines).real
    noise = 1e-3 * np.random.default_rng(4).standard_normal(len(times))
    near = fq.Record(values=[clean + noise], sample_rate=32.0, channels=["v"])
    for own, period in ((record, rotor.period), (near, 1.0)):
        found = fq.identify(own, period=period, validate=False, branch="symmetric")
        assert sum(one.code in {"branch_left", "branch_uneven"} for one in found.findings) == 1
    (told,) = (one for one in found.findings if one.code == "branch_uneven")
    assert told.numbers["squares"] > 10.0 * told.numbers["limit"]


def test_what_else_is_refused(model):
    with pytest.raises(InputError, match="`result` of `path_shapes` must be an Analysis or a PeriodicModel"):
        path_shapes("scan.h5")
    with pytest.raises(InputError, match=r"must lie between -1 and 1.*has 1\.5"):
        path_shapes(model).at([0.0, 1.5])


def test_three_periods_in_one_are_told_of_a_scan_too():
    """Two may be a path over the middle of a symmetric structure; three are none."""
    rotor = fq.systems.JeffcottRotor()
    record = rotor.simulate(n_periods=120, samples_per_period=12, noise=0.01, seed=0)
    found = fq.identify(record, period=3.0 * rotor.period, channels=["X", "Y"], branch="symmetric", validate=False)
    assert [own.numbers["times"] for own in found.findings if own.code == "period_multiple"] == [3]
