"""`floquid identify`: from files to exponents, shapes and A(t)."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Annotated, Literal

from cyclopts import Parameter

from floquid._checks import input_error
from floquid.cli._errors import CriteriaNotMetError
from floquid.cli._folder import result_folder
from floquid.cli._options import Debug, OptionalPlace, OptionalWhole, RecordFiles, Verbose, split
from floquid.cli._output import NAMES, print_json, write_result
from floquid.cli._progress import progress
from floquid.cli._record_options import RecordOptions
from floquid.cli._records import check_files, read_records
from floquid.cli._settings import Choices, IdentifierName, load_choices
from floquid.cli._terminal import print_analysis, print_folder
from floquid.errors import IdentificationError
from floquid.pipeline import identify as identify_records
from floquid.reconstruction import Form

OF = "floquid identify"
STAGES = 10


def identify(
    *files: RecordFiles,
    record: RecordOptions | None = None,
    identifier: IdentifierName | None = None,
    order: OptionalWhole = None,
    harmonics: OptionalWhole = None,
    states: str | None = None,
    form: Form | None = None,
    delay: float | None = None,
    structure: str | None = None,
    output_error: Annotated[bool | None, Parameter(negative=())] = None,
    forced: str | None = None,
    constrained: bool | None = None,
    validate: bool | None = None,
    enforce: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    out: OptionalPlace = None,
    format: Literal["text", "json"] = "text",  # noqa: A002
    settings: OptionalPlace = None,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Identify the Floquet exponents, the periodic mode shapes and A(t) from free responses.

    Parameters
    ----------
    files
        Records of free responses, of any format that is read. Several files are several hits on one system.
    record
        The clock of the records, their channels, and what is cut off.
    identifier
        The algorithm that finds the poles: ml, maximum likelihood (the usual one); ami, the Algorithm of Mode
        Isolation; era, the eigensystem realisation algorithm; lscf and poly, least-squares complex frequency and its
        poly-reference form; ami-ml, era-ml, lscf-ml and poly-ml, maximum likelihood started from them. era, lscf and
        poly give no standard deviations, and need --harmonics.
    order
        The number of complex poles, conjugates counted one by one; found from the data when not given.
    harmonics
        Keep the harmonics from minus to plus this of each mode; those above the noise when not given. Needed with era,
        lscf and poly.
    states
        The channels that are the displacement states of A(t), comma-separated; x+vx+ax for several channels of one
        motion, all for weighted sums of all channels; no A(t) when not given.
    form
        The states that A(t) is in: second-order, displacements and their velocities, when not given; first-order, as
        many channels as modes, as they are; delayed, channels and the same channels later, where they are too few.
    delay
        The delay of --form delayed [s]; the best one when not given.
    structure
        Fit A(t) with a structure, whose every element then has a small deviation: auto, the simplest one that the
        record does not contradict, or blocks with their harmonics, such as "stiffness 2 symmetric; damping 0 known
        0,1=0 1,0=0" or, with --form first-order, "system 2". One that contradicts the record is refused.
    output_error
        Fit the structure once more, to the record linearised anew at its exponents.
    forced
        The forced response beside the free one (imbalance, gravity, an orbit): auto finds it, none leaves it out, 1,2
        are harmonics of the revolution that are fitted in any case; auto when not given.
    constrained
        Finish with residues held to their harmonics, the usual end: smaller deviations where modes are weak, fast, or
        folded onto one another. --no-constrained keeps the residues of lifting free.
    validate
        Check the model: cycles left out are predicted, and what is left of the record is looked at; --no-validate does
        not.
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
        **(record or RecordOptions()).given(OF),
        identifier=identifier,
        order=order,
        harmonics=harmonics,
        states=None if states is None else split(states),
        form=form,
        delay=delay,
        structure=structure,
        output_error=output_error,
        forced=forced,
        constrained=constrained,
        validate=validate,
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
