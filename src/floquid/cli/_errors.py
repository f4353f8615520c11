"""Errors for a person: one message, in the words of the command line, and an exit code."""

from __future__ import annotations

import re
from dataclasses import fields

import numpy as np
from cyclopts import CycloptsError, UnusedCliTokensError

from floquid.errors import IdentificationError, InputError
from floquid.preparation import SHORT, Settings, for_command

FAILED, BAD_INPUT, NOT_MET, INTERRUPTED = 1, 2, 3, 130


class CriteriaNotMetError(Exception):
    """The result is written, and its validation was to be enforced and did not pass: the reasons."""


_SUBJECT = re.compile(r"Argument `([^`]*)` of `([^`]*)` must ")


def _alike(*names: str) -> dict[str, str]:
    """Arguments whose options have the same names."""
    return {name: f"`--{name.replace('_', '-')}`" for name in names}


_SETTINGS = {
    **_alike(*(field.name for field in fields(Settings))),
    **{name: f"`--{short.replace('_', '-')}`" for name, short in SHORT.items()},
    "period": "The period",
    "records": "The records",
}

_OPTIONS = {
    "read": {"path": "`FILE`", "period": "The period", **_alike("rate", "channels", "names", "origin", "header")},
    "floquet.read_matrix": {"paths": "`FILES`", **_alike("period", "interpolation")},
    "floquet.read_openfast": {"paths": "`FILES`"},
    "Settings": _SETTINGS,
    "identify": _SETTINGS,
    "identify_large": {**_SETTINGS, **_alike("memory")},
    "measure_transfer": {
        **_SETTINGS,
        **_alike("method", "harmonics", "repeat", "drop", "reference", "curvature"),
        "frequencies_hz": "`--at`",
    },
    "fit_transfer": {"period": "The period", "measured": "`--lines`"},
    "save_figure": {"path": "`--out`"},
    "multisine": {"sample_rate": "`--rate`", **_alike("period", "turns", "band", "inputs", "rms", "seed")},
    "Multisine.record": _alike("repeats"),
    "ConstantPeriod": {"period": "The period", "origin": "`--origin`"},
    "describe_file": {"path": "`FILE`", **_alike("rate", "channels", "header")},
    "write": {"path": "`--out`", "record": "The record"},
    "save": {"path": "`--out`"},
    "export_modes": {"path": "`OUT`", "coordinates": "`--coordinates`", "lines": "`--coordinates`"},
    "export_transfer": {"path": "`--out`", "found": "The transfer functions"},
    **{
        name: {
            "groups": "`--phases`",
            "currents": "`--phases`",
            "voltages": "`--phases`",
            "harmonics": "`--harmonics`",
            "subject": "The transfer functions",
            "period": "The period",
        }
        for name in ("to_dq", "to_alpha_beta", "to_sequence", "impedance")
    },
    "transfer": {"found": "The transfer functions"},
    "load": {"path": "`RESULT`"},
    "report": {"analysis": "`RESULT`", "path": "`--out`", "brief": "`--brief`"},
    **{f"Analysis.{name}": {"self": "The result"} for name in ("transfer", "lifted")},
    "fleet": {"sources": "`FILES`", **_alike("out", "keep", "workers")},
    "monitor": {
        "results": "`FILES`",
        "rate": "`--false-alarms`",
        "direction": "`--like`",
        **_alike("baseline", "covariates", "degree", "over"),
    },
    "survey": {"results": "`FILES`", **_alike("gap", "confidence")},
    "bootstrap": {"analysis": "`RESULT`", **_alike("draws", "seed", "workers", "whole")},
    "save_figures": {"folder": "`--out`"},
    "JeffcottRotor.simulate": {
        "n_periods": "`--periods`",
        **_alike("samples_per_period", "noise", "seed", "impulse_deg"),
    },
}
"""Words of the command line for the arguments of the library's callables, by callable and argument."""


def explained(error: BaseException) -> tuple[str, int]:
    """The message, and the exit code."""
    code = FAILED
    match error:
        case CycloptsError():
            words, code = explained_usage(error), BAD_INPUT
        case InputError():
            words, code = in_options(str(error)), BAD_INPUT
        case CriteriaNotMetError():
            words, code = str(error), NOT_MET
        case KeyboardInterrupt():
            words, code = "Interrupted before the end. A result is only ever written whole.", INTERRUPTED
        case IdentificationError():
            words = for_command(str(error))
        case MemoryError():
            words = (
                "This needs more memory than there is: use a shorter record or fewer channels (`identify --channels`)."
            )
        case OSError():
            where = f"{error.filename}: " if error.filename else ""
            words, code = f"{where}{error.strerror or error}.", BAD_INPUT
        case FloatingPointError() | np.linalg.LinAlgError():
            words = (
                f"The numbers of this record cannot be worked with ({error}): are there wrong samples, or channels "
                "that say nothing? `floquid info FILE` shows their range; choose others with `--channels`."
            )
        case _:
            words = (
                f"Unexpected {type(error).__name__}: {error}\n"
                "  This is a mistake in floquid. Run the command again with --debug and report what it prints."
            )
    return words, code


def in_a_line(error: BaseException) -> str:
    """The message in one line."""
    return " ".join(explained(error)[0].split())


def in_options(message: str) -> str:
    """A message about an argument of a callable as one about an option: «`--rate` must be …»."""
    match = _SUBJECT.match(message)
    message = for_command(message.replace("pass period=", "pass --period "))
    if match is None:
        return message
    argument, of = match[1], match[2]
    subject = f"`{argument}`" if of.startswith("floquid") else _OPTIONS.get(of, {}).get(argument)
    return message if subject is None else f"{subject} must {message[match.end() :]}"


def explained_usage(error: CycloptsError) -> str:
    """Message on the words typed, and where to read on."""
    if isinstance(error, UnusedCliTokensError):
        words = f"Too many words: {' '.join(error.unused_tokens or [])}."
    else:
        words = str(error)
    command = " ".join(["floquid", *(error.command_chain or ())])
    return f"{words}\n  Try `{command} --help`."
