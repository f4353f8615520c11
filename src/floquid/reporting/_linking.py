"""One mode is chosen on the whole page: what the browser does when it changes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from floquid.reporting._chosen_figures import Chosen

if TYPE_CHECKING:
    from bokeh.models import ColumnDataSource

CHOOSE = """
if (modes.selected.indices.length !== 1) {
    // One mode is always chosen: a click beside all marks changes nothing, one on several takes the first.
    modes.selected.indices = [modes.selected.indices.length ? modes.selected.indices[0] : last.get_column("row")[0]];
    return;
}
const row = modes.selected.indices[0];
last.data = {row: [row]};
for (let k = 0; k < drawn.length; k++) drawn[k].data = columns[k][row];
document.dispatchEvent(new CustomEvent("floquid:mode", {detail: row}));
"""

RESPONSE = """
const row = response.get_column("row")[0];
for (let k = 0; k < drawn.length; k++) drawn[k].data = columns[k][row];
for (let k = 0; k < axes.length; k++) axes[k].axis_label = labels[k][row];
"""


def link_modes(modes: ColumnDataSource, chosen: list[Chosen]) -> None:
    """Let the row selected in `modes` decide what the figures of the mode show."""
    from bokeh.models import ColumnDataSource, CustomJS

    last = ColumnDataSource({"row": [0]})
    modes.selected.js_on_change("indices", CustomJS(args=_args(chosen, modes=modes, last=last), code=CHOOSE))


def link_responses(chosen: list[Chosen], axes: list[Any], labels: list[list[str]]) -> ColumnDataSource:
    """A source whose one number says which response the figures of the record show, and how their axes are labelled."""
    from bokeh.models import ColumnDataSource, CustomJS

    response = ColumnDataSource({"row": [0]}, name="response")
    response.js_on_change(
        "data", CustomJS(args=_args(chosen, response=response, axes=axes, labels=labels), code=RESPONSE)
    )
    return response


def _args(chosen: list[Chosen], **others: Any) -> dict[str, Any]:
    return {"drawn": [one.drawn for one in chosen], "columns": [list(one.modes) for one in chosen], **others}
