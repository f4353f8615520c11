"""The report: one HTML page that opens without a network, with the verdict first and every figure linked.

`report` writes it. bokeh draws and jinja2 fills the page; both are loaded when the first page is made.
"""

from floquid.reporting._page import fragment
from floquid.reporting._report import ENDINGS, report

__all__ = ["report"]
