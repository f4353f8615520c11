"""`floquid floquet`: the exponents of a given A(t), and whether it is stable."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from floquid._arrays import Floats
from floquid._checks import input_error, positive
from floquid.cli.arguments.shared import Format, Frequency, OutputFolder, Place, period_of
from floquid.cli.output.floquet import AGREE, FILES, Examined, hill_claims, print_examined, save_modes, summary_text
from floquid.cli.output.folder import ResultFolder, maybe_folder
from floquid.cli.output.terminal import progress
from floquid.errors import IdentificationError, InputError
from floquid.floquet import (
    AbstractPeriodicMatrix,
    FloquetModes,
    HarmonicMatrix,
    HillModes,
    MatrixFile,
    OpenFastLinearisation,
    Stability,
    compare,
    exponents,
    hill,
    modes,
    read_matrix,
    stability,
    state_participation,
    upper_modes,
)

OF = "floquid floquet"
STAGES = 4

_STRUCTURE = re.compile(r"(ED|BD|BD_\d+|SD) ")
"""Prefixes of OpenFAST's states of motion: ElastoDyn, BeamDyn and SubDyn."""


def floquet(
    *files: Place,
    period: float | None = None,
    frequency: Frequency = None,
    interpolation: Literal["fourier", "cubic", "linear"] | None = None,
    tolerance: float = 1e-12,
    check: bool = True,
    out: OutputFolder = None,
    format: Format = "text",  # noqa: A002
) -> None:
    """Floquet exponents, periodic mode shapes and stability of a system whose A(t) is known.

    Parameters
    ----------
    files
        A(t): .npz, .mat, .h5 or .json with `A` (n, n, phases) over one period and `period`, or with `edges` where
        constant pieces begin, or `coefficients` (n, n, harmonics) and `harmonics`; summary.json or result.h5 of
        `floquid identify --states`; or the .lin files of OpenFAST over one revolution, or their folder.
    period
        The period of A(t) [s], where the file does not state it.
    interpolation
        What A(t) is between samples: fourier, the trigonometric polynomial through them; cubic, a spline; linear.
        When not given, fourier for samples at equal steps, cubic for others; of .lin files, the harmonics.
    tolerance
        The relative error of each factor of the transition over the period.
    check
        Find the exponents a second time by Hill's method, which integrates nothing, and compare; --no-check saves the
        time, which grows with the cube of states times harmonics.
    out
        A folder for summary.json, modes.npz, figures/exponents.png and figures/shapes.png.
    format
        text prints tables; json prints summary.json alone.
    """
    _check_options(files, tolerance, out)
    length = period_of(period, frequency, OF)
    if period is not None:
        positive(period, "--period", OF, unit="s")
    with maybe_folder(out, FILES) as folder, progress(STAGES + (2 if out else 0)) as report:
        report("reading")
        found = _examined(read_matrix(files, period=length, interpolation=interpolation), tolerance, check, report)
        text = summary_text(found)
        if folder is not None:
            _write(folder, found, text, report)
    if format == "json":
        sys.stdout.write(text)
        return
    print_examined(found, out)


def _examined(file: MatrixFile, tolerance: float, check: bool, report: Callable[[str], None]) -> Examined:
    """The modes of A(t), by two routes if wanted; the verdict; of a turbine, what half of its azimuths give."""
    report("integrating over the period")
    found = _modes(file.matrix, tolerance)
    second, difference, unchecked = None, None, ""
    if check:
        report("checking by Hill's method (--no-check leaves it out)")
        try:
            second = hill(file.matrix, raises=False, known=found)
            difference = compare(found, second.exponents)
        except InputError as error:
            unchecked = _refusal(error)
    turned = None
    if file.linearisation is not None:
        report("comparing with every other azimuth")
        turned = _halved(file.linearisation, found, tolerance)
    known = None
    if difference is not None and isinstance(second, HillModes) and second.converged:
        # What is more than Hill's method claims to be right to is a disagreement: it makes no growth a rest.
        known = np.minimum(difference, hill_claims(found, second))
    verdict = stability(found, tolerance=tolerance, errors=known)
    if difference is not None and known is not None:
        _refuse_disagreement(found, difference, verdict)
    checks = {"hill": second, "difference": difference, "unchecked": unchecked, "halved": turned}
    return Examined(file=file, modes=found, stability=verdict, **checks)


def _refuse_disagreement(found: FloquetModes, difference: Floats, verdict: Stability) -> None:
    """Refuse a result on which two routes disagree that both claim to be right."""
    relative = difference / np.maximum(np.abs(found.exponents), found.fundamental)
    worst = int(relative.argmax())
    if relative[worst] > AGREE:
        raise IdentificationError(
            f"Integration over the period and Hill's method disagree. Integration gives {found.exponents[worst]:.8g} "
            f"1/s (verdict: {verdict.verdict.value}); Hill's method settles {difference[worst]:.3g} 1/s away. The "
            f"limit is {AGREE:g} of max(|λ|, ω).\n"
            "  Lower --tolerance; where A(t) jumps give it with `edges`; or see the integration alone with --no-check."
        )


def _modes(matrix: AbstractPeriodicMatrix, tolerance: float) -> FloquetModes:
    """The modes; that A(t) was read and cannot be worked with is no mistake of usage."""
    try:
        return modes(matrix, tolerance=tolerance)
    except InputError as error:
        raise IdentificationError(_refusal(error)) from error


def _refusal(error: InputError) -> str:
    """Message on the argument, as one on A(t)."""
    return re.sub(r"Argument `system` of `floquet\.(modes|hill)` must", "A(t) must", str(error))


def _halved(model: OpenFastLinearisation, found: FloquetModes, tolerance: float) -> tuple[float, str]:
    """Difference of the exponents of every other azimuth from those of all [1/s], or why that is not known."""
    count = model.azimuths.size
    if count % 2 or count < 6:
        return float("nan"), f"there are {count}, and it takes an even number of six or more."
    half = model.every_other()
    harmonics, coefficients = half.harmonics()
    matrix = HarmonicMatrix(coefficients=coefficients, harmonics=harmonics, period=half.period)
    try:
        return float(compare(found, exponents(matrix, tolerance=tolerance)).max()), ""
    except InputError as error:
        return float("nan"), _refusal(error)


def _check_options(files: tuple[Path, ...], tolerance: float, out: Path | None) -> None:
    if not files:
        example = f"For example: {OF} rotor.npz"
        raise input_error("FILES", OF, "name at least one file with A(t)", "none was given", example)
    if not 1e-14 <= positive(tolerance, "--tolerance", OF) <= 1e-3:
        raise input_error("--tolerance", OF, "lie in [1e-14, 1e-3]", f"is {tolerance:g}")
    if out is not None and (out / "result.h5").exists():
        must = "be a folder without a result of `floquid identify`, whose summary.json would be replaced"
        raise input_error("--out", OF, must, f"{out} holds result.h5", "Choose another folder.")


def _moving(found: Examined) -> list[int] | None:
    """The least damped modes of a turbine's structure, at most three; None where the names of states tell of none.

    Wave filters of OpenFAST swing too, with less damping than any motion, and hide it.
    """
    structural = np.array([_STRUCTURE.match(name) is not None for name in found.file.states or ()], bool)
    if not structural.any() or structural.all():
        return None
    share = state_participation(found.modes)[:, structural].sum(axis=1)
    own = [mode for mode in upper_modes(found.modes) if share[mode] > 0.5]
    own.sort(key=lambda mode: (found.modes.exponents[mode].imag == 0.0, found.modes.damping_ratios[mode]))
    return own[:3] or None


def _write(folder: ResultFolder, found: Examined, text: str, report: Callable[[str], None]) -> None:
    """Write the files into the folder, where they take their names together."""
    from floquid import plot

    report("writing the result")
    figures = folder.unfinished / "figures"
    figures.mkdir()
    folder.write("summary.json", text)
    save_modes(found, folder.unfinished / "modes.npz")
    report("drawing the figures")
    plot.save_figure(plot.exponents(found.modes), figures / "exponents.png")
    plot.save_figure(plot.periodic_shapes(found.modes, found.file.states, _moving(found)), figures / "shapes.png")
    folder.publish()
