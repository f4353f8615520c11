"""Figures 2 to 8 of the paper from our own run, each with the paper's words and with what is to be seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from benchmarks.paper._experiment import CUTS, MASS, TURNTABLE, Reproduction, uncut
from benchmarks.paper._numbers import Number
from benchmarks.paper._residues import coefficients, residues

from floquid import plot
from floquid._arrays import Floats
from floquid.lti import WHITE, composites
from floquid.pipeline import Analysis
from floquid.reconstruction import StateModel, reconstruct

if TYPE_CHECKING:
    from floquid.plot import Figure


FIRST, SHOWN = 0, 22  # the indices of the 1st and the 23rd lifted response

STANDS_OUT = 4.0  # least ratio of a peak to its surroundings. White noise does so on one line in a hundred thousand.

TOP, NEAR, AROUND = 0.004, 0.012, 0.06
"""A peak is the largest line within the first of these of a frequency; its surroundings are the lines between the
second and the third [fundamentals]."""

ELEMENTS = ((3, 1), (3, 2), (3, 3))

NAMES = ("AMI", "max. likelihood")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PaperFigure:
    """One figure of the paper, redrawn.

    Parameters
    ----------
    number
        Its number in the paper.
    title
        What it shows.
    statement
        What the paper says of it, quoted or nearly so.
    source
        Where the paper says so.
    seen
        What is to be seen in ours, in numbers computed from it.
    figure
        The figure.
    """

    number: int
    title: str
    statement: str
    source: str
    seen: str
    figure: Figure


def figures(reproduction: Reproduction) -> tuple[PaperFigure, ...]:
    """Figures 2 to 8 of Allen 2009 from a `reproduction`, in the paper's order."""
    mode = _first_mode(reproduction.ami)
    return (
        _record(reproduction),
        _spectra(reproduction, MASS),
        _spectra(reproduction, TURNTABLE),
        _composites(reproduction),
        _residues(reproduction, mode),
        _coefficients(reproduction, mode),
        _system(reproduction),
    )


def _named(done: Reproduction) -> dict[str, Analysis]:
    return dict(zip(NAMES, (done.ami, done.maximum_likelihood), strict=True))


def _first_mode(analysis: Analysis) -> int:
    """The paper's first mode: that of the smallest principal |Im λ|, on its physical branch with Im λ > 0."""
    size = np.abs(analysis.model.principal().imag)
    upper = analysis.model.exponents.imag > 0
    return int(np.argmin(np.where(upper, size, np.inf)))


def _record(done: Reproduction) -> PaperFigure:
    true, folded = _strongest(done.maximum_likelihood, 0, None), _strongest(done.maximum_likelihood, 0, FIRST)
    fundamental = done.exact.fundamental
    return PaperFigure(
        number=2,
        title="the response X in time, with noise",
        statement="Circles mark the response points for which the shaft is at an angle of 0 or 180 degrees; the lifted "
        "response aliases the true response frequency.",
        source="section 3.1 and the figure's caption",
        seen=f"X rings at {true:.3f} rad/s. Its circles, one each half revolution, ring at {folded:.3f} rad/s, which "
        f"is |{true:.3f} − {fundamental:g}|: folded. After {_buried(done):.0%} of the record the response is below the "
        "noise.",
        figure=plot.time_record(done.maximum_likelihood, "X", FIRST, periods_per_revolution=2),
    )


def _buried(done: Reproduction) -> float:
    """The share of the record after which the response of X has decayed to the deviation of the noise."""
    analysis = done.maximum_likelihood
    share = analysis.lifted.noise[0, 0] / np.abs(analysis.model.response(done.record.times)[0]).max()
    return float(np.log(share) / analysis.model.exponents.real.max() / done.record.times[-1])


def _spectra(done: Reproduction, channels: tuple[str, str]) -> PaperFigure:
    analysis = done.maximum_likelihood
    model = analysis.model
    rows = [[channel.name for channel in model.channels].index(name) for name in channels]
    upper = model.exponents[model.exponents.imag > 0].imag
    family = np.sort(np.abs(np.add.outer(upper, np.array([-1, 0, 1]) * model.fundamental)).ravel())
    found = {name: prominent(analysis, row, None, family) for name, row in zip(channels, rows, strict=True)}
    raw = "; ".join(f"{name} at {_listed(peaks)}" for name, peaks in found.items())
    folded = np.sort(np.abs(model.principal().imag[model.exponents.imag > 0]))
    lifted = [prominent(analysis, row, phase, folded) for row in rows for phase in (FIRST, SHOWN)]
    most = max(len(peaks) for peaks in lifted)
    mass = channels == MASS
    return PaperFigure(
        number=3 if mass else 4,
        title=f"spectra of the {'mass, X and Y' if mass else 'turntable, X_tt and Y_tt'}",
        statement="The response in all of the outputs is dominated by two resonance peaks surrounding 0.8 rad/s. "
        + (
            "Figure 3 shows two other pairs of peaks at 0.2 and 1.8 rad/s, although the latter are almost completely "
            "masked by the noise. Each FFT of a lifted response shows at most two resonant peaks."
            if mass
            else "In contrast, Figure 4 shows noticeable harmonics only at 1.8 rad/s. Each FFT of a lifted response "
            "shows at most two resonant peaks."
        ),
        source="section 3.1",
        seen=f"Four times or more above what surrounds it stands {raw} rad/s (the height over the surroundings in "
        f"brackets). The lifted responses shown have {most} peaks at most, at "
        f"{' and '.join(f'{value:.3f}' for value in folded)} rad/s, and their heights differ with the angle.",
        figure=plot.spectra(analysis, channels, (FIRST, SHOWN), angular=True, periods_per_revolution=2),
    )


def _listed(peaks: dict[float, float]) -> str:
    return ", ".join(f"{frequency:.3f} ({height:.0f})" for frequency, height in peaks.items()) or "none"


def _composites(done: Reproduction) -> PaperFigure:
    words = []
    for name, analysis in _named(done).items():
        found = composites(analysis.lifted.responses, analysis.modal)
        level = found.difference / WHITE
        words.append(f"for {name} {level.mean():.3f} on average and {level.max():.2f} at most")
    return PaperFigure(
        number=5,
        title="composites of the lifted responses",
        statement="The reconstruction agrees very well with the data, and the difference curve shows that the data "
        "appears to contain only noise after the contributions of these two modes are removed, confirming that only "
        "two modes are active.",
        source="section 3.1",
        seen=f"The difference lies on the level of white noise: over it, {', '.join(words)}. A line is the mean of 200 "
        "magnitudes, and scatters by 4 %; the two algorithms' curves cannot be told apart by eye.",
        figure=plot.composite(_named(done), angular=True),
    )


def _residues(done: Reproduction, mode: int) -> PaperFigure:
    exponent = done.ami.model.exponents[mode]
    parts, constants, others = [], [], []
    for row, channel in enumerate(done.ami.model.channels):
        constant, varying, scatter, predicted = _residue_of(done.ami, mode, row)
        parts.append(f"{channel.name} {constant:.3f}, {varying:.3f} and {scatter:.4f} (from the noise {predicted:.4f})")
        (constants if constant > varying else others).append(channel.name)
    return PaperFigure(
        number=6,
        title="residue of the first mode against the angle of the shaft",
        statement="The residues are predominantly constant, although they do vary slightly with shaft angle in a "
        "sinusoidal manner, and they are somewhat jagged, presumably due to the effect of the noise.",
        source="section 3.1; the text says that both parts are shown, the caption only the imaginary one",
        seen=f"By AMI the constant, the rest of the smooth part and the scatter about it, root mean square, are: "
        f"{'; '.join(parts)}. Predominantly constant: {_and(constants)}; not so: {_and(others)}. Each panel has its "
        f"own scale. Ours are drawn for λ = {exponent.real:.4f} + {exponent.imag:.4f} i, where the largest harmonic of "
        "the mode is the zeroth; on the principal branch they would turn once a period. A dot in a ring is where both "
        "algorithms agree.",
        figure=residues(_named(done), mode, periods_per_revolution=2),
    )


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _and(names: list[str]) -> str:
    return " and ".join(names) or "none"


def _coefficients(done: Reproduction, mode: int) -> PaperFigure:
    words = []
    for name, analysis in _named(done).items():
        kept, smallest, dropped = _coefficients_of(analysis, mode, 0)
        words.append(
            f"by {name} {kept} are kept, the smallest {smallest:.0f} deviations high, and the largest of the others is "
            f"{dropped:.1f} deviations"
        )
    return PaperFigure(
        number=7,
        title="Fourier coefficients of the residue of X in the first mode, and the residue",
        statement="Only three terms stand out significantly above the noise for each residue. The reconstructed "
        "residue follows the general trend of the identified residue, but is much smoother.",
        source="section 3.2",
        seen=f"{_capital('; '.join(words))}. What is left between rings and line below is the noise that was thrown "
        "away with the other coefficients.",
        figure=coefficients(_named(done), mode, "X", periods_per_revolution=2),
    )


def _system(done: Reproduction) -> PaperFigure:
    states: dict[str, StateModel] = {
        name: reconstruct(CUTS["three"][1](uncut(analysis)), MASS, harmonics="model")
        for name, analysis in _named(done).items()
    }
    words = []
    for name, state in states.items():
        off = np.abs(state.system - done.rotor.system(state.times)).max(axis=0)
        elements = ", ".join(f"{off[i - 1, j - 1]:.4f} in A({i},{j})" for i, j in ELEMENTS)
        row, column = np.unravel_index(np.argmax(off), off.shape)
        words.append(
            f"{name} is off by at most {elements}; the worst element is A({row + 1},{column + 1}), {off.max():.4f}"
        )
    times = np.linspace(0.0, done.rotor.period, 361)
    return PaperFigure(
        number=8,
        title="elements of A(t), from the three dominant coefficients of each residue",
        statement="The curves overlay one another. At 0° A(3,1) equals -0.5; A(3,2) is zero at 0° and K12 has its "
        "largest negative value at 45°; A(3,3) is much smaller than the stiffness and appears to be constant.",
        source="section 3.2 and the figure's caption",
        seen=f"{'. '.join(_capital(line) for line in words)}. Each element has its own scale here: on the paper's, 0.7 "
        "high, the errors of A(3,3) cannot be seen.",
        figure=plot.system_elements(
            states, ELEMENTS, (times, done.rotor.system(times)), period=done.rotor.period, periods_per_revolution=2
        ),
    )


def _lines(analysis: Analysis, row: int, phase: int | None) -> tuple[Floats, Floats]:
    """Frequencies [rad/s] and magnitudes of a channel's periods, or of its lifted response at a phase (lines,)."""
    cycles = analysis.cycles[0]
    values = cycles.values[row].T.ravel() if phase is None else cycles.values[row, phase]
    step = analysis.lifted.period / (cycles.n_phases if phase is None else 1)
    frequencies = 2.0 * np.pi * np.arange(len(values) // 2 + 1) / (len(values) * step)
    return np.asarray(frequencies, dtype=np.float64), np.asarray(np.abs(np.fft.rfft(values)), dtype=np.float64)


def _strongest(analysis: Analysis, row: int, phase: int | None) -> float:
    """The frequency of the highest line of a channel, or of its lifted response at a phase [rad/s]."""
    frequencies, magnitudes = _lines(analysis, row, phase)
    return float(frequencies[np.argmax(magnitudes)])


def prominent(analysis: Analysis, row: int, phase: int | None, candidates: Floats) -> dict[float, float]:
    """Candidates [rad/s] that stand out, with their heights over the median of their surroundings."""
    frequencies, magnitudes = _lines(analysis, row, phase)
    found = {}
    for candidate in candidates:
        away = np.abs(frequencies - candidate) / analysis.model.fundamental
        top = away <= max(TOP, away.min())
        around = magnitudes[(away > NEAR) & (away < AROUND)]
        height = float(magnitudes[top].max() / np.median(around)) if len(around) else 0.0
        if height >= STANDS_OUT:
            found[float(candidate)] = height
    return found


def _residue_of(analysis: Analysis, mode: int, row: int) -> tuple[float, float, float, float]:
    """Parts of a residue: its constant, the rest of its smooth part, the scatter about it, and that of the noise."""
    model, whole = analysis.model, uncut(analysis)
    assert whole.coefficient_std is not None
    own, kept = model.coefficients[mode, row, 0], model.harmonics
    dropped = ~np.isin(whole.harmonics, kept[own != 0])
    rest = whole.coefficients[mode, row, 0, dropped]
    std = np.abs(whole.coefficient_std[mode, row, 0, dropped])
    return (
        float(np.abs(own[kept == 0]).sum()),
        float(np.linalg.norm(own[kept != 0])),
        float(np.linalg.norm(rest)),
        float(np.linalg.norm(std)),
    )


def _coefficients_of(analysis: Analysis, mode: int, row: int) -> tuple[int, float, float]:
    """Number of kept coefficients of a residue, the smallest of them and the largest of the others [deviations]."""
    model, whole = analysis.model, uncut(analysis)
    assert whole.coefficient_std is not None
    size = np.abs(whole.coefficients[mode, row, 0])
    std = np.abs(whole.coefficient_std[mode, row, 0])
    heights = np.divide(size, std, out=np.zeros_like(size), where=std > 0)
    kept = np.isin(whole.harmonics, model.harmonics[model.coefficients[mode, row, 0] != 0])
    return int(kept.sum()), float(heights[kept].min()), float(heights[~kept].max())


COLUMNS = ("what", "printed", "corrected", "AMI", "maximum likelihood")

LEGEND = (
    "*Corrected* is the right value by the rotor's equations; of an error, what is left of it with exact residues. "
    "*AMI* and *maximum likelihood* are ours: (19) is one standard deviation in the last digits, and without one the "
    "value is that of the first draw of the noise. All is without dimension: time is counted in 1/ω_n, though axes and "
    "units say s."
)

INTRODUCTION = (
    "M. S. Allen, Frequency-Domain Identification of Linear Time-Periodic Systems using LTI Techniques (2009), section "
    "3: a rotor on an anisotropic shaft in anisotropic bearings, simulated and identified again by the paper's "
    "algorithm (AMI) and by maximum likelihood. Under each figure's title stands what the paper says of it, then what "
    "ours shows."
)


def table(rows: Sequence[Number]) -> str:
    """The numbers in `rows` as tables in Markdown, one a section of the paper, with their notes below."""
    lines: list[str] = []
    notes: list[str] = []
    section = None
    for number in rows:
        if number.section != section:
            section = number.section
            lines += ["", f"**Section {section}**", "", _row(COLUMNS), _row(["---", *["--:"] * 4])]
        what = number.what.strip()
        if number.note:
            if number.note not in notes:
                notes.append(number.note)
            what += f" [{notes.index(number.note) + 1}]"
        lines.append(_row(["&emsp;" * number.what.startswith(" ") + what, *number.cells]))
        lines += [_row([f"&emsp;{words}", "", "", ami, ml]) for words, ami, ml in number.over_draws]
    lines += ["", *(f"{place}. {note}" for place, note in enumerate(notes, start=1))]
    return "\n".join([LEGEND, *lines]) + "\n"


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def figure_text(figure: PaperFigure) -> str:
    """A heading of the `figure`, what the paper says of it and what is to be seen in ours, as Markdown."""
    return f"## Figure {figure.number}: {figure.title}\n\n> {figure.statement} ({figure.source})\n\n{figure.seen}\n"


def page(figures: Sequence[PaperFigure], rows: Sequence[Number], path: Callable[[PaperFigure], str]) -> str:
    """The whole comparison as a page of Markdown: the `figures`, each beside the paper's words, then the `rows`.

    `path` says where the picture of a figure is, as seen from the page.
    """
    parts = ["# The application of Allen's paper, redrawn and recomputed\n", f"{INTRODUCTION}\n"]
    for figure in figures:
        parts += [figure_text(figure), f"![Figure {figure.number}: {figure.title}]({path(figure)})\n"]
    parts += ["## Every number of section 3\n", table(rows)]
    return "\n".join(parts)
