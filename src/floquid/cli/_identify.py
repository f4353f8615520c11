"""`floquid identify`: from files to exponents, shapes and A(t)."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Annotated, Literal

from cyclopts import Parameter

from floquid.cli._options import Debug, OptionalPlace, OptionalWhole, Place, split
from floquid.cli._output import print_json, result_folder
from floquid.cli._progress import progress
from floquid.cli._records import check_files, period_of, read_records
from floquid.cli._settings import Choices, IdentifierName, load_choices
from floquid.cli._terminal import print_analysis, print_folder
from floquid.pipeline import identify as identify_records

OF = "floquid identify"
STAGES = 8


def identify(
    *files: Place,
    period: float | None = None,
    frequency: float | None = None,
    origin: float | None = None,
    rate: float | None = None,
    channels: str | None = None,
    identifier: IdentifierName | None = None,
    order: OptionalWhole = None,
    harmonics: OptionalWhole = None,
    states: str | None = None,
    constrained: Annotated[bool | None, Parameter(negative=())] = None,
    trust_period: Annotated[bool | None, Parameter(negative=())] = None,
    out: OptionalPlace = None,
    format: Literal["text", "json"] = "text",  # noqa: A002
    settings: OptionalPlace = None,
    debug: Debug = False,
) -> None:
    """Identify the Floquet exponents, the periodic mode shapes and A(t) from free responses.

    Parameters
    ----------
    files
        Records of free responses: .npz, .csv, .mat, .h5, .hdf5, .uff, .unv. Several files are several hits on one
        system.
    period
        The period of the system [s]: half a revolution for a two-fold symmetric shaft seen from the ground.
    frequency
        The fundamental frequency [Hz], one over the period; instead of --period.
    origin
        The time of phase zero [s]; 0 when not given.
    rate
        The sampling rate [Hz], overriding what the files say.
    channels
        The channels to use, comma-separated; all when not given. In .mat and .h5 files of other names, the paths of
        the variables: run/acc/x, or data[2] for a row, data.T[2] for a column.
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
        The channels that are the displacement states of A(t), comma-separated; no A(t) when not given.
    constrained
        Finish with residues held to their harmonics: smaller deviations where modes are weak, fast, or folded onto one
        another.
    trust_period
        Warn instead of refusing when the response seems to repeat with another period than the one given.
    out
        A folder for result.h5, summary.json, settings.toml and figures/.
    format
        text prints tables; json prints summary.json alone.
    settings
        A settings.toml written by an earlier run; options given here come first.
    debug
        Show the traceback of an error.
    """
    del debug
    check_files(files, OF)
    choices = (Choices() if settings is None else load_choices(settings)).with_given(
        period=period_of(period, frequency, OF),
        rate=rate,
        origin=origin,
        channels=None if channels is None else split(channels),
        identifier=identifier,
        order=order,
        harmonics=harmonics,
        states=None if states is None else split(states),
        constrained=constrained,
        trust_period=trust_period,
    )
    with (
        nullcontext() if out is None else result_folder(out) as folder,
        progress(STAGES + (1 if choices.settings.constrained else 0) + (3 if out else 0)) as report,
    ):
        records, choices = read_records(files, choices, OF, report)
        analysis = identify_records(records, choices.resolved(), report=report)
        if folder is not None:
            folder.write(analysis, choices.text(), report)
    if format == "json":
        print_json(analysis)
        return
    print_analysis(analysis)
    print_folder(out)
