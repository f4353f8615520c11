"""Each law fails of a likelihood that breaks it, and of mistakes planted in the library."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.contracts.likelihoods._decays import Decays
from tests.contracts.likelihoods._driven import Driven
from tests.contracts.likelihoods._innovations import Innovations
from tests.contracts.likelihoods._laws import LAWS
from tests.contracts.likelihoods._lines import LinePoint
from tests.contracts.likelihoods._point import Mode, Normal, Point
from tests.contracts.likelihoods._records import CASES, Case

from floquid.innovations import _predictor
from floquid.inputs import _modes, _transfer, input_gain
from floquid.periodic.least_squares import GappyBlock, RecordBlock, _solver
from floquid.periodic.least_squares._parameters import Rows

POINTS = {"decays": Decays, "driven": Driven, "innovations": Innovations, "lines": LinePoint}


def record(name: str) -> Case:
    """A fresh copy of a case, of which nothing is kept."""
    return replace(next(case for case in CASES if case.name.startswith(name)))


def scaled(name: str, by: float):
    """A method or property of a point, by a factor."""

    def broken(kind):
        own = getattr(kind, name)
        if isinstance(own, property):
            return name, property(lambda self: by * own.fget(self))
        return name, lambda self, group: by * own(self, group)

    return broken


def normal(gradient: float, matrix: float):
    """The linearisation, its gradient and matrix by factors."""

    def broken(kind):
        own = kind.normal

        def of(self) -> Normal:
            found = own(self)
            return Normal(found.names, gradient * found.gradient, matrix * found.matrix)

        return "normal", of

    return broken


def likelihood(of):
    """L with something added that it must not depend on."""

    def broken(kind):
        own = kind.log_likelihood.fget
        return "log_likelihood", property(lambda self: own(self) + of(self))

    return broken


def parts(point: Point) -> float:
    return 10.0 * (len(point.data.starts) + point.modes[0].gains.size)


BROKEN = {
    "gradient": normal(1.01, 1.0),
    "curvature": normal(1.0, 0.5),
    "score": scaled("score", 1.4),
    "wald": scaled("wald", 1.4),
    "conditioning": scaled("covariance", 1.5),
    "units": likelihood(lambda point: float(np.abs(point.modes[0].shape).max())),
    "order": likelihood(lambda point: 10.0 * point.modes[0].exponent.real),
    "conjugate": likelihood(lambda point: 10.0 * point.modes[0].exponent.imag),
    "split": likelihood(parts),
}


def test_every_law_is_broken_but_the_one_of_names() -> None:
    assert {*BROKEN, "branch"} == set(LAWS)


@pytest.mark.slow
@pytest.mark.parametrize("law", BROKEN)
@pytest.mark.parametrize("kind", POINTS)
def test_a_likelihood_that_breaks_a_law_fails_it(kind: str, law: str, monkeypatch: pytest.MonkeyPatch) -> None:
    case = record(kind)
    assert case.truth is not None
    monkeypatch.setattr(POINTS[kind], *BROKEN[law](POINTS[kind]))
    with pytest.raises(AssertionError):
        LAWS[law](case)


@pytest.mark.slow
@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize("side", ["seen", "driven"])
def test_a_harmonic_that_is_not_renamed_fails(kind: str, side: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if kind == "decays" and side == "driven":
        pytest.skip("free responses have no inputs")
    own = Mode.renamed
    monkeypatch.setattr(Mode, "renamed", lambda self, *args: replace(own(self, *args), **{side: getattr(self, side)}))
    with pytest.raises(AssertionError):
        LAWS["branch"](record(kind))


def by(value, factor: float):
    return lambda *args, **words: factor * value(*args, **words)


PARTS = Rows.of_coefficients


def backwards(self, count):
    """Places and signs, those of frequencies the other way round."""
    place, signs = PARTS(self, count)
    return place, np.where(self.turned[:, None], -signs, signs)


PLANTED = {
    "the slope by a frequency has the wrong sign": ("gradient", "decays: as", Rows, "of_coefficients", backwards),
    "the matrix is halved": ("curvature", "decays: lifted", _solver, "folded", by(_solver.folded, 0.5)),
    "missing samples are not taken off": ("split", "decays: with gaps", GappyBlock, "sums", RecordBlock.sums),
    "inputs drive without their harmonic": (
        "branch", "driven", _modes, "input_gain", lambda exponent, turn, *rest: input_gain(exponent, 0.0, *rest)),
    "first states fade too slowly": (
        "split", "driven", _modes, "begun_by", lambda samples, mode: np.abs(BEGUN(samples, mode)) ** 0.5),
    "harmonics of either sign are one": (
        "conjugate", "innovations", _predictor, "turning",
        lambda samples, turns, *rest: TURNING(samples, abs(turns), *rest)),
    "a derivative by differences that are too wide": ("gradient", "lines", _transfer, "HALF_DIGITS", 0.1),
    "the conjugate is left out": ("conjugate", "lines", _transfer, "terms_of", lambda *args: TERMS(*args)[:1]),
}  # fmt: skip
BEGUN, TURNING, TERMS = _modes.begun_by, _predictor.turning, _transfer.terms_of


@pytest.mark.parametrize("mistake", PLANTED)
def test_a_mistake_in_the_library_fails(mistake: str, monkeypatch: pytest.MonkeyPatch) -> None:
    law, name, place, attribute, wrong = PLANTED[mistake]
    monkeypatch.setattr(place, attribute, wrong)
    with pytest.raises(AssertionError):
        LAWS[law](record(name))
