"""`floquid identify`: from files to exponents, shapes and A(t)."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Annotated

from cyclopts import Parameter

from floquid._checks import input_error
from floquid.cli._errors import CriteriaNotMetError
from floquid.cli._folder import result_folder
from floquid.cli._options import Debug, Format, OutputFolder, RecordFiles, SettingsFile, Verbose
from floquid.cli._output import NAMES, print_json, write_result
from floquid.cli._progress import progress
from floquid.cli._records import check_files, read_records
from floquid.cli._setting_options import ModelOptions, RecordOptions, given
from floquid.cli._settings import Choices, load_choices
from floquid.cli._terminal import print_analysis, print_folder
from floquid.errors import IdentificationError
from floquid.pipeline import identify as identify_records

OF = "floquid identify"
STAGES = 10


def identify(
    *files: RecordFiles,
    record: RecordOptions | None = None,
    model: ModelOptions | None = None,
    enforce: Annotated[bool, Parameter(negative="", show_default=False, group="Checks")] = False,
    out: OutputFolder = None,
    format: Format = "text",  # noqa: A002
    settings: SettingsFile = None,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Identify the Floquet exponents, the periodic mode shapes and A(t) from free responses.

    Parameters
    ----------
    files
        Records of free responses, of any format that is read. Several files are several hits on one system.
    record, model
        The fields of `Settings`.
    enforce
        End with exit code 3 and the reasons where the model does not pass its checks; the result is written all the
        same. A model that fails, since it leaves many times the noise, ends with exit code 1 in any case.
    out
        A folder for result.h5, summary.json, settings.toml, figures/ and report.html, a page for the browser.
    format
        text prints tables; json prints summary.json alone.
    settings
        A settings.toml written by an earlier run; options given here come first.
    verbose
        Print the reasons too: the noise of each channel, why the order is what it is, what the columns are.
    debug
        Show the traceback of an error.
    """
    del debug
    check_files(files, OF)
    choices = (Choices() if settings is None else load_choices(settings)).with_given(
        **given(record, OF), **given(model, OF)
    )
    if enforce and not choices.settings.validate:
        must, got = "come with the checks of the model", "they are switched off"
        raise input_error(
            "--enforce", OF, must, got, "Leave out --no-validate, and `validate = false` in the settings."
        )
    with (
        nullcontext() if out is None else result_folder(out, NAMES) as folder,
        progress(STAGES + (5 if out else 0) + (3 if choices.settings.structure else 0)) as report,
    ):
        records, choices = read_records(files, choices, OF, report)
        analysis = identify_records(records, choices.resolved(), report=report)
        if folder is not None:
            write_result(folder, analysis, choices.text(), report)
    if format == "json":
        print_json(analysis)
    else:
        print_analysis(analysis, verbose=verbose)
        print_folder(out)
    if analysis.failed:
        raise IdentificationError(analysis.warnings[0])
    if enforce and analysis.validation is not None and not analysis.validation.passed:
        reasons = analysis.validation.reasons or analysis.validation.unmet
        raise CriteriaNotMetError("\n  ".join(["The model does not pass its checks.", *reasons]))
