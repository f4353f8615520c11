"""The page put together: figures as scripts, words through a template, everything in one file."""

from __future__ import annotations

import json
import re
from importlib.resources import files
from typing import TYPE_CHECKING, Any

from floquid.findings import Severity, texts
from floquid.pipeline import Analysis
from floquid.preparation import for_command
from floquid.reporting import _words as words
from floquid.reporting._case import Case, Figure
from floquid.reporting._chosen_figures import family_source, harmonic_source, link_responses
from floquid.reporting._driven_figures import (
    harmonic_figure,
    left_out_figures,
    matrix_rows,
    measured_beside,
    measured_figures,
    paths_of,
    reach_figures,
    transfer_figures,
)
from floquid.reporting._modes_figures import Truth, mode_figures, mode_source, system_figures
from floquid.reporting._record_figures import (
    composite_figure,
    indicator_figures,
    record_figures,
    response_label,
    response_name,
    response_sources,
    responses,
    slip_words,
    slips,
    spectrum_figure,
    spectrum_label,
    speed_figure,
    stabilisation_figures,
    synchronisation_figure,
)
from floquid.views import (
    DAMPING_WORDS,
    DampingUnit,
    SpeedUnit,
    branch_words,
    couple_words,
    mode_table,
    note_meanings,
    spectra_of_modes,
    speed_texts,
)

if TYPE_CHECKING:
    from jinja2 import Environment

PLACES = (
    *("shape", "coefficients", "spectrum", "stabilisation", "unfolded", "indicators", "plane", "composite", "harmonic"),
    *("transfer", "measured", "reach", "record", "synchronisation", "left_out", "system", "driving", "speed"),
)
"""Places of figures on the page."""

NOTHING: dict[str, Any] = {
    **dict.fromkeys(("reasons", "checks", "evidence", "responses", "synchronisation", "noise", "noise_titles"), ()),
    **dict.fromkeys(("inputs", "matrix", "harmonics", "beside", "hits", "parameters"), ()),
    **dict.fromkeys(("responses_left", "paths_shown", "paths_left"), 0),
    **dict.fromkeys(("ambient", "held_out", "fails"), False),
    **dict.fromkeys(("state", "refinement")),
}
"""Content that not every page has."""

LONGEST = 60  # the longest name of a source that fits a heading, in characters


def page(case: Case, *, title: str | None, truth: Truth | None, unit: SpeedUnit = "hz") -> str:
    """The whole page of an analysis as text: sections by what it has; the speed of the shaft in a `unit`."""
    analysis: Analysis = case.analysis
    titles, noise = words.noise_table(analysis)
    content = (
        verdict_of(analysis)
        | modes_of(analysis, case.damping)
        | {
            "summary": words.summary_line(case, unit),
            "checks": words.checks(analysis),
            "evidence": words.evidence(analysis),
            "ambient": analysis.ambient,
            "inputs": analysis.inputs,
            "hits": [hit + 1 for hit in case.hits] if analysis.model.n_hits > 1 else [],
            "state": analysis.state,
            "refinement": analysis.refinement,
            "parameters": [] if analysis.refinement is None else words.parameters(analysis.refinement),
            "steps": words.steps(analysis, unit),
            "warnings": speed_texts(analysis.findings, unit, Severity.WARNING),
            "noise": noise,
            "noise_titles": titles,
        }
    )
    figures, more = (decay_part if analysis.driven is None else driven_part)(case)
    figures |= system_figures(analysis, truth)
    figures["speed"] = [speed_figure(shaft, unit) for shaft in analysis.shafts[:1]]
    return rendered(case, figures, title, **content | more)


def decay_part(case: Case) -> tuple[dict[str, list[Figure]], dict[str, Any]]:
    """Figures by their places, and content, that free responses alone have."""
    found, analysis = slips(case), case.analysis
    modes, curves, family = mode_source(case), response_sources(case), family_source(case)
    figures = mode_figures(case, modes, family) | {
        "record": record_figures(case, curves),
        "spectrum": [spectrum_figure(case, curves, family)],
        "composite": [composite_figure(case)],
        "synchronisation": [made for made in (synchronisation_figure(found),) if made is not None],
    }
    if case.scan is not None:
        folded, unfolded = stabilisation_figures(case, modes)
        figures |= {"stabilisation": [folded], "unfolded": [unfolded], "indicators": indicator_figures(case)}
    shown = [*figures["record"], *figures["spectrum"]]
    names = [response_label, response_label, spectrum_label]
    labels = [[name(case, number) for number in range(len(responses(case)))] for name in names]
    # What no figure draws has to hang on one to be found on the page.
    shown[0].tags = [link_responses(list(curves.values()), [made.yaxis[0] for made in shown], labels)]
    content = {
        "responses": [response_name(case, *one) for one in responses(case)],
        "responses_left": len(analysis.model.channels) * len(analysis.records) - len(responses(case)),
        "synchronisation": slip_words(found),
    }
    return figures, content


def driven_part(case: Case) -> tuple[dict[str, list[Figure]], dict[str, Any]]:
    """Figures by their places, and content, that records whose excitation goes on alone have."""
    analysis, chosen = case.analysis, []
    record, held_out = left_out_figures(case)
    content: dict[str, Any] = {"held_out": held_out}
    figures: dict[str, list[Figure]] = {"left_out": record}
    if analysis.ambient:
        spectra = spectra_of_modes(analysis)
        chosen = [harmonic_source(spectra)]
        figures["harmonic"] = [harmonic_figure(spectra, *chosen)]
    figures |= mode_figures(case, mode_source(case), *chosen)
    if not analysis.inputs:
        return figures, content
    found = analysis.transfer()
    paths = paths_of(found, analysis.noise, analysis.driven.samples.input_size)
    figures |= {"transfer": transfer_figures(found, paths), "reach": reach_figures(case)}
    measured, beside = measured_beside(analysis, found)
    if measured is not None:
        lines = measured.transfer
        at, drawn = (analysis.transfer(hertz, lines.harmonics, sampled=True) for hertz in (lines.frequencies_hz, None))
        figures["measured"] = measured_figures(lines, at, drawn, paths)
    content |= {
        "matrix": matrix_rows(found, paths),
        "harmonics": found.harmonics.tolist(),
        "beside": beside,
        "paths_shown": len(paths),
        "paths_left": len(analysis.inputs) * len(analysis.model.channels) - len(paths),
    }
    return figures, content


def rendered(case: Case, figures: dict[str, list[Figure]], title: str | None, **content: Any) -> str:
    """The page with these figures by their places; what `content` does not have, the page does without."""
    models = {f"{place}-{number}": made for place, group in figures.items() for number, made in enumerate(group)}
    drawn = {
        place: listed({f"{place}-{number}": made for number, made in enumerate(group)})
        for place, group in figures.items()
    }
    analysis = case.analysis
    return filled(
        "page.html.jinja",
        **NOTHING
        | content
        | {
            "title": title or title_of(case),
            **drawn_by(models),
            "figures": dict.fromkeys(PLACES, ()) | drawn,
            "case": case,
            "told": analysis.model.unselected is not None,
            "shaped": analysis.model.estimates is not None,
            "given": analysis.settings.harmonics is not None,
            "left_out": len(analysis.model.channels) - len(case.channels),
            "sources": words.sources(analysis),
            "settings": words.settings_rows(analysis),
        },
    )


def drawn_by(figures: dict[str, Figure]) -> dict[str, Any]:
    """Content of a page with these `figures` by the names of their places: scripts, data, and their descriptions."""
    content = {"bokeh": bokeh_scripts(), "embedded": embedded(figures), "behaviour": asset("page.js")}
    return content | {"figures": listed(figures)}


def listed(figures: dict[str, Figure]) -> list[dict[str, str]]:
    """The places of `figures` with their descriptions."""
    return [{"name": name, "words": described(made)} for name, made in figures.items()]


def filled(template: str, **content: Any) -> str:
    """The text of a page by its `template`, with the style and the version that all pages have."""
    from floquid._version import __version__

    return _environment().get_template(template).render(version=__version__, style=asset("page.css"), **content)


def fragment(analysis: Analysis) -> str:
    """The verdict and the table of modes of an `analysis` as a piece of HTML."""
    warnings = texts(analysis.findings, Severity.WARNING)
    template = _environment().get_template("fragment.html.jinja")
    return template.render(**verdict_of(analysis), **modes_of(analysis), warnings=warnings)


def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("floquid.reporting", "page"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"minus": words.minus, "options": _with_code}
    return environment


def verdict_of(analysis: Analysis) -> dict[str, Any]:
    """The verdict as the templates have it."""
    mark, sentence, under = words.verdict(analysis)
    return {"mark": mark, "sentence": sentence, "under": under, "reasons": analysis.reasons}


def modes_of(analysis: Analysis, unit: DampingUnit = "percent") -> dict[str, Any]:
    """The table of modes as the templates have it, damping in a `unit`."""
    table, bands = mode_table(analysis, damping_unit=unit), analysis.model.exponent_std is not None
    damping, meanings = words.minus(DAMPING_WORDS[unit]), [*note_meanings(table), *couple_words(analysis.model)]
    branch = branch_words(analysis)
    return {
        "table": table, "damping": damping, "meanings": meanings, "bands": bands, "fails": analysis.failed,
        "branch": branch,
    }  # fmt: skip


def _with_code(text: str) -> Any:
    """The text with options as the command has them, and what stands in backticks as code."""
    from markupsafe import Markup, escape

    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(for_command(text)))))  # noqa: S704  # escaped


def bokeh_scripts() -> str:
    """The scripts that draw figures, to be held by a page."""
    from bokeh.resources import Resources

    return "\n".join(Resources(mode="inline", components=["bokeh"]).js_raw)


def described(made: Figure) -> str:
    """Description of a figure, in words."""
    heading = f"{made.title.text}: " if made.title is not None and made.title.text else ""
    legend = [item.label.value for item in made.legend[0].items] if made.legend else []
    curves = f"; {', '.join(legend)}" if legend else ""
    return f"{heading}{made.yaxis[0].axis_label} against {made.xaxis[0].axis_label}{curves}"


def title_of(case: Case) -> str:
    """The names of the files, or of what was simulated."""
    named = [_short(source) for source in words.sources(case.analysis)]
    return ", ".join(named[:3]) + (" …" if len(named) > 3 else "") if named else "A record"


def _short(source: str) -> str:
    """The name of a file without its folder; of a long description, its beginning."""
    if len(source) <= LONGEST or "(" not in source:
        return source.replace("\\", "/").rsplit("/", 1)[-1][-LONGEST:]
    return source[: source.index("(")][:1].upper() + source[1 : source.index("(")]


def embedded(figures: dict[str, Figure]) -> str:
    """Content that bokeh draws in the elements of these names, as JSON in which no text of a record can end the script.

    The models are numbered anew: bokeh numbers those of a whole process, and the same analysis gives the same page.
    """
    from bokeh.document import Document

    document = Document()
    with document.models.freeze():
        for made in figures.values():
            document.add_root(made)
    numbers: dict[str, str] = {}
    content = _numbered(document.to_json(deferred=False), numbers)
    roots = {numbers[made.id]: name for name, made in figures.items()}
    item = {"docid": "report", "roots": roots, "root_ids": list(roots)}
    text = json.dumps({"documents": {"report": content}, "items": [item]}, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def _numbered(part: Any, numbers: dict[str, str]) -> Any:
    """JSON with the identities of models by their order of appearance."""
    if isinstance(part, dict):
        return {
            key: numbers.setdefault(value, f"m{len(numbers)}")
            if key == "id" and isinstance(value, str)
            else _numbered(value, numbers)
            for key, value in part.items()
        }
    if isinstance(part, (list, tuple)):
        return [_numbered(one, numbers) for one in part]
    return part


def asset(name: str) -> str:
    """A file of the page as text."""
    return (files("floquid.reporting") / "page" / name).read_text(encoding="utf-8")
