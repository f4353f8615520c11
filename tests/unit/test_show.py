"""Results that show themselves: short reprs, the text and the table of modes, the figures."""

import importlib
import inspect
import pkgutil
from dataclasses import dataclass, fields, is_dataclass, replace
from inspect import signature
from typing import get_origin

import numpy as np
import pytest
from tests.contracts.test_copies import parts, record

import floquid
from floquid import _arrays, floquet, identify, order, plot
from floquid._checks import Rebuilt
from floquid._show import Brief
from floquid.core import Channel
from floquid.findings import Finding, Severity
from floquid.lti import AMI
from floquid.pipeline import Settings, bootstrap
from floquid.plot import FIGURES
from floquid.systems import JeffcottRotor, Run


@pytest.fixture(scope="module")
def analysis():
    return identify(record(), states=["X", "Y"])


@pytest.fixture(scope="module")
def results(analysis):
    rotor = JeffcottRotor()
    known = floquet.FunctionMatrix(function=rotor.system, period=rotor.period, vectorised=True)
    return {
        "analysis": analysis,
        "bootstrap": bootstrap(replace(analysis, state=None), draws=20, workers=1),
        "scan": order.scan(analysis.lifted.responses, orders=(2, 4)),
        "modes": floquet.modes(known),
    }


def test_every_part_of_a_result_is_one_short_line(results):
    settings = Settings(channels=[f"a channel of a long name, {n}" for n in range(100)], identifier=AMI())
    harmonics = floquet.HarmonicMatrix(coefficients=np.zeros((9, 9, 3)), harmonics=(-1, 0, 1), period=1.0)
    every = [*results.values(), settings, harmonics, Run(), Channel(name="x" * 1000), record()]
    shown = {repr(part) for one in every for part in parts(one)}
    assert len(shown) > 30
    assert not [text for text in shown if len(text) >= 300 or "\n" in text]


def test_every_public_type_with_arrays_is_brief():
    rooms = [importlib.import_module(found.name) for found in pkgutil.iter_modules(floquid.__path__, "floquid.")]
    shown = {name: getattr(room, name) for room in rooms for name in getattr(room, "__all__", ())}
    kinds = {name: kind for name, kind in shown.items() if inspect.isclass(kind) and is_dataclass(kind)}
    words = ("NDArray", *(name for name, kind in vars(_arrays).items() if get_origin(kind) is np.ndarray))
    arrays = {name for name, kind in kinds.items() if any(word in str(f.type) for f in fields(kind) for word in words)}
    # It is made in the inmost loop of a fit.
    assert {name for name in arrays if not issubclass(kinds[name], Brief)} == {"ModeParameters"}


def test_a_repr_says_what_is_not_the_default():
    assert repr(Settings()) == "Settings()"
    given = Settings(period=0.1, channels=("X", "Y"), form="first-order", identifier=AMI(most=8))
    assert repr(given).startswith("Settings(period=0.1, channels=('X', 'Y'), form='first-order', identifier=AMI(")
    plain = replace(given, identifier=None)
    assert eval(repr(plain)) == plain


def test_the_reprs_of_the_main_results(analysis):
    assert repr(analysis) == "Analysis(order=4, period=6.283 s, 4 channels, 60 periods: passes)"
    assert repr(replace(analysis, validation=None)).endswith(": not checked)")
    assert repr(replace(analysis, validation=replace(analysis.validation, passed=False))).endswith(": fails)")
    assert repr(analysis.records[0]).startswith(
        "Record(4 channels: X, Y, X_tt, Y_tt; 720 samples at 1.9098593 Hz; Const"
    )
    assert repr(analysis.model) == "PeriodicModel(order=4, period=6.2831853 s, channels=4, hits=1, harmonics=3)"


def test_a_class_keeps_a_repr_of_its_own_and_a_subclass_too():
    @dataclass(frozen=True, slots=True)
    class Own(Brief):
        values: tuple

        def __repr__(self):
            return "own"

    @dataclass(frozen=True, slots=True)
    class Plain(Rebuilt):
        values: tuple
        function: object = None

    assert repr(Own(values=())) == "own"
    assert repr(Plain(values=(np.zeros((2, 3)),), function=max)) == "Plain(values=((2, 3),), function=max(…))"
    assert repr(Plain(values=tuple(range(9)))) == "Plain(values=(0, 1, 2, 3, … 9 in all))"


def test_the_summary_has_the_modes_and_the_verdict(results):
    begins = {
        "analysis": ("1 record, 4 channels", "Modes: order 4", "Verdict passes"),
        "bootstrap": ("20 records drawn from the model", "Ratio over all elements", "deviations hold"),
        "scan": ("Orders, conjugate poles", "ΔBIC", "singular values"),
        "modes": ("Stability: asymptotically stable", "Modes: order 4", "folded"),
    }
    for name, words in begins.items():
        text = results[name].summary()
        assert all(word in text for word in words), text
        assert text.startswith(words[0])
        assert "--" not in text
        assert max(map(len, text.splitlines())) <= 100


def test_the_summary_warns(analysis):
    failing = identify(record(noise=1e-3), order=2)
    assert f"  {failing.reasons[0][:40]}" in failing.summary()
    assert "<p><strong>The model fails.</strong>" in failing._repr_html_()
    assert failing.warnings[0][:40] in failing._repr_html_()


def test_the_page_of_a_notebook_has_a_row_a_mode(analysis, results):
    html = analysis._repr_html_()
    assert html.startswith("<p><strong>The model passes its checks.</strong>")
    assert html.count("<tr data-row=") == 2
    assert "±" in html
    against = replace(analysis.validation, passed=False)
    assert "does not pass" in replace(analysis, validation=against)._repr_html_()
    hostile = replace(analysis, findings=(Finding("sentence", Severity.WARNING, {}, "", "<script>"),))
    assert "&lt;script&gt;" in hostile._repr_html_()
    assert "<script>" not in hostile._repr_html_()
    assert results["scan"]._repr_html_().startswith("<pre>Orders")


def test_the_figures_are_those_of_plot(results):
    """Each function of `plot` gets what it is drawn of, and its signature is that without it."""
    found = results["analysis"]
    assert set(dir(found.plot)) == set(FIGURES) - {"speed", "transfer", "harmonic_spectra"}
    assert dir(found.model.plot) == dir(results["modes"].plot) == ["exponents", "periodic_shapes"]
    assert dir(found.state.plot) == ["system_elements"]
    assert dir(results["scan"].plot) == ["indicators", "stabilisation"]
    for one in (found, found.model, found.state, *(results[name] for name in ("scan", "modes"))):
        for name in dir(one.plot):
            method, function = getattr(one.plot, name), getattr(plot, name)
            assert list(signature(method).parameters) == list(signature(function).parameters)[1:]
            assert method.__doc__ == function.__doc__
    assert len(found.plot.spectra(channels=["X"], angular=True).axes) >= 2
    assert results["scan"].plot.stabilisation(chosen=4).axes
    with pytest.raises(AttributeError, match="this Analysis has no figure 'stabilisation'; those it has: compo"):
        found.plot.stabilisation()
