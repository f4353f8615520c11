"""Findings of the stages, by code and numbers, and the table that has the words.

A stage of the chain returns a `Finding`: a code, how much it matters, the numbers, and where it is. `str(finding)` is
the sentence for people, of the one table of words here; a result file keeps code, numbers and text. Words name the
options of Python as `name=`; the command and the page say what they are called there.

Decision 0026 says why the words stand below the stages, not in `views`.
"""

from floquid.findings._finding import Finding, Severity, as_mapping, failure, from_mapping, note, texts, warning

__all__ = ["Finding", "Severity", "as_mapping", "failure", "from_mapping", "note", "texts", "warning"]
