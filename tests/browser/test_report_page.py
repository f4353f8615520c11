"""The report in a browser: a pole that is clicked changes the shape, and nothing is asked of the network."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import floquid as fq
from floquid import views
from floquid.findings import Finding

ROTOR = Path(__file__).parents[2] / "examples" / "rotor"

PERIOD = 0.015789473684210523
HOSTILE = "</script><script>window.broken=1</script><img src=x onerror='window.broken=2'>"

POINT = """
([name, renderer, index]) => {
    const view = [...Bokeh.index].find((one) => one.model.name === `${name}-figure`);
    const source = view.model.renderers.find((one) => one.name === renderer).data_source;
    const glyph = view.model.renderers.find((one) => one.name === renderer).glyph;
    const box = view.el.getBoundingClientRect();
    const x = source.get_column(glyph.x.field)[index], y = source.get_column(glyph.y.field)[index];
    return [box.x + view.frame.x_scale.compute(x), box.y + view.frame.y_scale.compute(y)];
}
"""
SOURCE = """([name, column]) => [...Bokeh.documents[0].get_model_by_name(name).get_column(column)]"""
CHOSEN = "() => Bokeh.documents[0].get_model_by_name('modes').selected.indices"


@cache
def read():
    """The physics engine's rotor: eight modes, two hits."""
    return fq.identify([fq.read(ROTOR / f"hit{n}.npz", period=PERIOD) for n in (1, 2)], validate=False)


def upper(analysis):
    return np.flatnonzero(analysis.model.exponents.imag > 0)


@pytest.fixture(scope="module")
def rotor(tmp_path_factory):
    """Its report."""
    return fq.report(read(), tmp_path_factory.mktemp("report") / "rotor.html")


class Watched:
    """A page, what it asked for, and what it complained of."""

    def __init__(self, browser, width, height):
        self.page = browser.new_page(viewport={"width": width, "height": height})
        self.requests, self.complaints = [], []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("console", lambda said: self.complaints.append(said.text) if said.type == "error" else None)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))

    def open(self, path):
        self.page.goto(path.resolve().as_uri())
        self.page.wait_for_function("() => Bokeh.documents.length === 1 && Bokeh.documents[0].is_idle")
        return self.page


@pytest.fixture(scope="module")
def desktop(browser, rotor):
    """The rotor's report, which takes seconds to open: tests share it."""
    watched = Watched(browser, 1280, 900)
    watched.open(rotor)
    yield watched
    watched.page.close()


@pytest.fixture(scope="module")
def phone(browser, rotor):
    watched = Watched(browser, 390, 844)
    watched.open(rotor)
    yield watched
    watched.page.close()


@pytest.fixture
def page(desktop):
    """That report with its first mode chosen."""
    desktop.page.locator(".chooser button").first.click()
    return desktop.page


def clicked(page, figure, renderer, index):
    """Click the mark of a row of a figure."""
    page.locator(".plot").nth(0).wait_for()
    x, y = page.evaluate(POINT, [figure, renderer, index])
    page.evaluate("(y) => window.scrollTo(0, window.scrollY + y - window.innerHeight / 2)", y)
    page.wait_for_timeout(100)
    x, y = page.evaluate(POINT, [figure, renderer, index])
    page.mouse.click(x, y)
    page.wait_for_timeout(100)


def test_a_click_on_a_pole_shows_the_shape_of_its_mode(desktop, page):
    before = page.evaluate(SOURCE, ["shape", "real0"])
    rows = page.evaluate(
        "() => [...Bokeh.index].find((one) => one.model.name === 'unfolded-figure').model.renderers"
        ".find((one) => one.name === 'poles-shape').data_source.get_column('row')"
    )
    row = max(rows)
    assert row > 0
    clicked(page, "unfolded", "poles-shape", len(rows) - 1 - rows[::-1].index(row))
    assert page.evaluate(CHOSEN) == [row]
    after = page.evaluate(SOURCE, ["shape", "real0"])
    assert len(after) == len(before)
    assert np.abs(np.subtract(after, before)).max() > 1e-3 * np.abs(before).max()
    assert page.locator(".chooser button[aria-checked=true]").inner_text() == str(row + 1)
    assert page.locator(".modes tr.chosen th").inner_text() == str(row + 1)
    assert page.locator("#told").inner_text().startswith(f"Mode {row + 1}:")
    assert desktop.complaints == []


def test_a_click_on_an_exponent_and_beside_it(page):
    clicked(page, "exponents", "mode-marks", 6)
    assert page.evaluate(CHOSEN) == [6]
    told = next(family for family in views.families(read()) if family.mode == upper(read())[6])
    shown = page.evaluate(SOURCE, ["family", "frequency"])
    np.testing.assert_allclose(shown, told.omega / (2.0 * np.pi), rtol=1e-6)
    page.evaluate("() => { Bokeh.documents[0].get_model_by_name('modes').selected.indices = []; }")
    assert page.evaluate(CHOSEN) == [6], "one mode is always chosen"


def test_the_keyboard_chooses_a_mode(page):
    page.locator(".chooser button").first.focus()
    page.keyboard.press("ArrowRight")
    assert page.evaluate(CHOSEN) == [1]
    assert page.evaluate("() => document.activeElement.textContent") == "2"
    page.keyboard.press("End")
    assert page.evaluate(CHOSEN) == [7]
    page.keyboard.press("ArrowRight")
    assert page.evaluate(CHOSEN) == [0]


def test_every_shape_is_the_models(page):
    model = read().model
    for row, mode in enumerate(upper(read())):
        page.locator(".chooser button").nth(row).click()
        turns = np.array(page.evaluate(SOURCE, ["shape", "turns"]))
        shown = np.array(page.evaluate(SOURCE, ["shape", "real0"]))
        hit = int(page.locator("#hit").inner_text()) - 1
        np.testing.assert_allclose(shown, model.shapes(turns * PERIOD)[mode, 0, hit].real, rtol=1e-6, atol=1e-12)


def test_another_response_is_shown(page):
    before = page.evaluate(SOURCE, ["record", "y"])
    page.locator(".response select").first.select_option(index=10)
    after = page.evaluate(SOURCE, ["record", "y"])
    assert after != before
    labels = page.evaluate(
        "() => [...Bokeh.index].filter((one) => ['record-figure', 'spectrum-figure'].includes(one.model.name))"
        ".map((one) => one.model.left[0].axis_label)"
    )
    assert sorted(labels) == ["magnitude [rad · s]", "response [rad]"]
    assert page.locator(".response select").last.input_value() == "10"


@pytest.mark.parametrize("size", ["desktop", "phone"])
def test_nothing_is_asked_of_the_network(size, request):
    watched = request.getfixturevalue(size)
    page = watched.page
    page.mouse.wheel(0, 20_000)
    page.wait_for_timeout(300)
    assert [url for url in watched.requests if not url.startswith(("file:", "data:", "blob:"))] == []
    assert watched.complaints == []
    assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth"), "it scrolls sideways"


def test_a_table_that_goes_on_says_so(desktop, phone):
    assert phone.page.locator("#modes .wide.more").count() == 1
    assert desktop.page.locator(".wide.more").count() == 0


def test_on_paper_the_buttons_are_gone(page):
    page.emulate_media(media="print")
    try:
        assert not page.locator(".chooser").is_visible()
        assert not page.locator("nav").is_visible()
        assert page.locator("#verdict-title").is_visible()
        folded = page.locator("details").all()
        assert folded
        assert not any(one.is_visible() for one in folded)
        assert page.locator("#told").is_visible(), "the paper says which mode the figures show"
        # The paper is 680 pixels wide between its margins.
        page.set_viewport_size({"width": 680, "height": 900})
        cut = """() => [...document.querySelectorAll(".wide, .plot, main, table")]
            .filter((one) => one.scrollWidth > one.clientWidth + 1).map((one) => one.outerHTML.slice(0, 90))"""
        for _ in range(50):  # figures follow the width some time later, on a busy machine seconds
            if page.evaluate(cut) == []:
                break
            page.wait_for_timeout(100)
        assert page.evaluate(cut) == [], "it is cut on paper"
        assert page.pdf(prefer_css_page_size=True).count(b"/Type /Page\n") >= 3
        # A browser prints the whole page smaller where a legend is moved to the right, deep in a figure's own tree.
        moved = page.evaluate("""() => {
            const legends = (root) => [...root.querySelectorAll("*")].flatMap((one) =>
                [...(one.matches(".bk-Legend") ? [parseFloat(getComputedStyle(one).left) || 0] : []),
                 ...(one.shadowRoot ? legends(one.shadowRoot) : [])]);
            return legends(document);
        }""")
        assert len(moved) > 5
        assert max(moved) < 10.0
    finally:
        page.set_viewport_size({"width": 1280, "height": 900})
        page.emulate_media(media="screen")


@pytest.mark.parametrize("many", [False, True])
def test_the_brief_is_one_page(browser, many, tmp_path):
    analysis = read()
    if many:
        said = tuple(
            Finding("sentence", "warning", words=f"Warning {k}. " + "Word after word. " * 20) for k in range(9)
        )
        analysis = replace(analysis, findings=(*analysis.findings, *said))
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.goto(fq.report(analysis, tmp_path / "brief.html", brief=True).as_uri())
    assert page.pdf(prefer_css_page_size=True).count(b"/Type /Page\n") == 1
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 680, "height": 1009})  # the paper between its margins
    whole, picture, last = (page.locator(one).bounding_box() for one in ("body", "img", "footer"))
    assert last["y"] + last["height"] <= whole["y"] + whole["height"] + 1.0
    assert picture["height"] > 180.0
    assert page.locator(".modes tbody tr").count() == 8
    page.close()


def test_names_of_channels_run_nothing(browser, tmp_path):
    record = fq.systems.JeffcottRotor().simulate(n_periods=128, noise=0.02, seed=1).select(["X", "Y"])
    channels = [replace(record.channels[0], name=HOSTILE), replace(record.channels[1], name="{{ 7 * 7 }}")]
    record = replace(record, channels=channels)
    path = fq.report(fq.identify(record, validate=False), tmp_path / "hostile.html", title=HOSTILE)
    watched = Watched(browser, 1280, 900)
    page = watched.open(path)
    page.wait_for_timeout(200)
    assert page.evaluate("() => window.broken") is None
    assert page.locator("h1").inner_text() == HOSTILE
    assert "{{ 7 * 7 }}" in page.locator(".response select").first.inner_text()
    assert watched.complaints == []
    page.close()
