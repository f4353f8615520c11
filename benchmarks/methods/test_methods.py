"""Each method once on a small record, beside the truth; the bounds and the transfer functions of the judge."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.methods import entries, measure, single, tables
from benchmarks.methods.records import CASES, driven_bound, free_bound, sampled_transfer, truth

from floquid.errors import IdentificationError
from floquid.findings import failure
from floquid.testing import pair_exponents

SMALL = {
    "free": CASES["free, Mathieu"],
    "driven": CASES["driven, Mathieu, 60 periods"],
    "ambient": replace(CASES["ambient, Mathieu"], periods=300),
}
LONG = {"modes fitted to these lines": CASES["driven, Mathieu"]}
"""Records of methods that want more: 60 periods have fewer lines than the harmonics of one mode have numbers."""

WITHIN = {
    "Peters and Wang": 20.0,
    "restoring force": 100.0,
    "Hilbert": 1000.0,
    "plain LTI (ERA, raw)": 8.0,
    "Hench; Verhaegen and Yu": 8.0,
    "Liu; Shi, Law and Li": 60.0,
    "Felici et al.": 30.0,
    "Okajima": 15.0,
    "plain LTI (pyOMA2, raw)": 60.0,
    "plain LTI (pyOMA2, lifted)": 10.0,
}
"""Bounds within which a method is, 4 where not said: about twice what it is off by in the table."""

EXACT = ("Peters and Wang", "Hench; Verhaegen and Yu", "Liu; Shi, Law and Li", "Okajima", "plain LTI (pyOMA2, lifted)")


def bound_of(case):
    """Deviations of the exponent, real and imaginary; that of outputs alone as of 1000 periods by identify."""
    if case.kind == "free":
        return free_bound(case)[:, 0]
    return driven_bound(case)[:, 0] if case.kind == "driven" else 0.0053 * np.sqrt(1000.0 / case.periods) * np.ones(2)


@pytest.mark.parametrize("method", entries.METHODS, ids=lambda method: f"{method.kind}: {method.name}")
def test_a_method_is_as_far_off_as_it_is_said_to_be(method):
    case = LONG.get(method.name, SMALL[method.kind])
    found = method.run(case)
    if found.exponents is None:
        assert measure.transfer_error(found, case) < 0.1
        return
    (error,), std = measure.errors_of(found, case)
    off = np.abs([error.real, error.imag]) / bound_of(case)
    assert off.max() < WITHIN.get(method.name, 4.0)
    assert (std is not None) == ("±" in method.returns)
    if std is not None:
        assert max(abs(error.real) / std[0].real, abs(error.imag) / std[0].imag) < 4.0


@pytest.mark.parametrize("name", EXACT)
def test_a_subspace_is_exact_without_noise(name):
    method = next(own for own in entries.METHODS if own.name == name and own.kind != "ambient")
    case = replace(SMALL[method.kind], noise=1e-9)
    (error,), _ = measure.errors_of(method.run(case), case)
    assert abs(error) < 1e-5


@pytest.mark.parametrize("method", [single.free_vibration, single.restoring_force])
def test_methods_of_one_degree_of_freedom_are_right_where_variation_is_slow(method):
    """x'' + 0.02 x' + (2 - 0.5 cos 0.1 t) x = 0, a fourteenth of the carrier."""
    slow = replace(
        CASES["free, Mathieu"].system,
        A=lambda t: np.array([[0.0, 1.0], [-(2.0 - 0.5 * np.cos(0.1 * t)), -0.02]]),
        period=20.0 * np.pi,
    )
    values = slow.response(np.zeros((1, 2400)), 400, start=[0.0, 1.0])
    found = method(values, slow.period / 400, slow.period)
    assert np.abs(pair_exponents(found, slow.exponents(400), slow.period).differences).max() < 2e-3


def test_the_bound_of_measured_inputs_is_what_the_chain_states():
    """Its harmonics are chosen by tests: somewhat more or fewer of them are free."""
    case = SMALL["driven"]
    (_, std) = measure.errors_of(entries.driven(case), case)
    assert np.array([std[0].real, std[0].imag]) == pytest.approx(driven_bound(case)[:, 0], rel=0.15)


def test_transfer_functions_of_samples_are_those_of_a_steady_response():
    case = CASES["driven, Mathieu"]
    periods, lead, line = 50, 50, 7
    k = np.arange((periods + lead) * case.phases)
    hertz = line / (periods * case.system.period)
    steady = case.system.response(np.cos(2.0 * np.pi * line * k / (periods * case.phases))[None], case.phases)
    lines = np.fft.fft(steady[:, lead * case.phases :]) / (periods * case.phases)
    expected = [2.0 * lines[0, (line + m * periods) % lines.shape[1]] for m in (-1, 0, 1)]
    found = sampled_transfer(case.system, case.phases, np.array([hertz]), [-1, 0, 1])
    assert found.ravel() == pytest.approx(np.array(expected), abs=1e-4)


def test_a_shift_by_bounds_is_that_error_and_a_run_that_fails_is_lost():
    case = SMALL["free"]
    shift = free_bound(case)[0, 0] * 3.0
    known = replace(entries.METHODS[0], run=lambda own: entries.Found(truth(own.system) + shift))
    (row,) = measure.over_bounds([measure.measured(known, [case])])
    assert row["error"] == pytest.approx(3.0 / np.sqrt(2.0))
    assert (row["lost"], row["z"], row["runs"]) == (0, None, 1)

    def fails(own):
        raise ZeroDivisionError("as written")

    (row,) = measure.over_bounds([measure.measured(replace(known, run=fails), [case])])
    assert (row["lost"], row["error"], row["failures"]) == (1, None, ["ZeroDivisionError: as written"])
    assert "(1 of 1 lost)" in tables.table([row], "free", 1)


def test_a_model_that_fails_by_its_own_word_is_lost():
    with pytest.raises(IdentificationError, match="Neither decays nor grows"):
        entries.believed(None, (failure("ambient_line", frequencies=[50.0]),))
