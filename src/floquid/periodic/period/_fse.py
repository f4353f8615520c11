"""The Fourier series expansion as an identification: lines of the response as it is, grouped into families."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import Rebuilt, frozen_array, input_error, positive
from floquid.core import PeriodicModel, Provenance, Record
from floquid.errors import IdentificationError
from floquid.lti import AbstractIdentifier
from floquid.periodic.least_squares import ModeParameters, RecordBlock, linearise, model_of
from floquid.periodic.period._harmonic_families import Average, Group, averaged, entries_of, grouped
from floquid.periodic.period._spectral_lines import Lines, after_phase_zero, beside, find_lines, lines_by, raw_blocks


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Family(Rebuilt):
    """Lines λ + imω of one mode, and their average.

    Parameters
    ----------
    exponent
        The average λ, on the branch of the strongest line [1/s].
    exponent_std
        Its deviation: of the real part the real part, of the imaginary part the imaginary one [1/s].
    lines
        The lines as they were found, on the upper half of the plane, the strongest first (lines,) [1/s].
    line_std
        Their deviations likewise (lines,) [1/s].
    harmonics
        m of each line (lines,).
    conjugated
        Whether it is the conjugate of a line that is the harmonic (lines,).
    """

    exponent: complex
    exponent_std: complex
    lines: Complexes
    line_std: Complexes
    harmonics: Integers
    conjugated: Mask

    def __post_init__(self) -> None:
        put, n = object.__setattr__, len(self.lines)
        for name, kind in (("lines", complex), ("line_std", complex), ("harmonics", np.int64), ("conjugated", bool)):
            put(self, name, frozen_array(getattr(self, name), name, "Family", axes=(n,), dtype=kind))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FSE(Rebuilt):
    """Result of the FSE method.

    Parameters
    ----------
    model
        The periodic model of the families.
    families
        The lines of each mode, strongest first.
    alone
        Lines that belong to no family (lines,) [1/s].
    undamped
        Pure tones, as far as the record tells: of a forced response, not of a mode (lines,) [1/s].
    misfit, degrees
        How far the lines are from families, a chi-square and its degrees of freedom.
    noise
        The deviation of what is left (channels, hits) [units of the channels].
    """

    model: PeriodicModel
    families: tuple[Family, ...]
    alone: Complexes
    undamped: Complexes
    misfit: float
    degrees: int
    noise: Floats

    def __post_init__(self) -> None:
        put = object.__setattr__
        for name in ("alone", "undamped"):
            put(self, name, frozen_array(getattr(self, name), name, "FSE", axes=("lines",), dtype=np.complex128))
        put(self, "noise", frozen_array(self.noise, "noise", "FSE", axes=("channels", "hits")))


def fse(
    records: Sequence[Record],
    *,
    period: float,
    identifier: AbstractIdentifier | None = None,
    order: int | None = None,
    least: int = 1,
) -> FSE:
    r"""The periodic model of records as they are, not lifted: an LTI system of many poles.

    .. math:: y(t) = \sum_r \sum_m B_{r,m}\, e^{(\lambda_r + i m \omega)(t - t_0)}

    (Allen 2009, eqs. 11-12.) Every line λ + imω is a pole of its own. Those of equal decay whose imaginary parts, or
    those of their conjugates, are whole multiples of ω apart, within their deviations, are a family; their average,
    with the inverse of the covariance of all lines as weight, is the exponent of the mode, on the branch of its
    strongest line. Amplitudes are the least squares at these averages, over the harmonics from the lowest to the
    highest line. `fit` enforces the spacing from the start, and then sees weaker harmonics too.

    Returns the model, with its covariance; the families; and the lines that belong to none.

    Raises InputError where `records` do not belong together, have missing samples that the identifier cannot do
    without, or `period` is not a period that the sampling shows; IdentificationError where no family rises above the
    noise.

    Parameters
    ----------
    records
        One record, or one a hit on the same system, of equal channels.
    period
        The period T [s], taken as exact.
    identifier
        What finds the poles: any identifier of `floquid.lti`. One that gives no covariance starts the least squares of
        its poles. None finds one line after another in the spectrum of what is left, each fitted with all others.
    order
        The number of poles that `identifier` is to find, conjugates one by one; None where it decides.
    least
        Lines that a family has at least; with 1 a line alone is a mode whose shape has one harmonic.
    """
    fundamental = 2.0 * np.pi / positive(period, "period", "fse", unit="s")
    if period * min(r.sample_rate for r in records) < 2.0:
        must = "be two sampling intervals or more"
        raise input_error("period", "fse", must, f"is {period:g} s", "Check the period and the sampling rate.")
    blocks = raw_blocks(records)
    lines = find_lines(blocks) if identifier is None else lines_by(identifier, records, blocks, order=order)
    damped = lines.picked(~lines.undamped)
    groups = grouped(damped, fundamental)
    alone = [line for group in groups if len(group.lines) < least for line in group.lines]
    damped, others = (
        damped.picked(np.setdiff1d(np.arange(len(damped.exponents)), alone)),
        damped.picked(np.array(alone, np.int64)),
    )
    if not len(damped.exponents):
        raise IdentificationError("Identification ended without a result: no family of lines rises above the noise.")
    groups = grouped(damped, fundamental)
    average = averaged(damped, groups, fundamental, free=False)
    entries, undamped = entries_of(groups, average), lines.exponents[lines.undamped]
    beside_them = np.concatenate([undamped, others.exponents])
    model = model_at(records, blocks, entries, average.covariance, beside_them, entries.bands, lines.noise)
    return FSE(
        model=model,
        families=tuple(families_of(damped, groups, average)),
        alone=others.exponents,
        undamped=undamped,
        misfit=average.misfit,
        degrees=average.degrees,
        noise=lines.noise,
    )


def model_at(
    records: Sequence[Record],
    raw: Sequence[RecordBlock],
    entries: ModeParameters,
    covariance: Floats,
    others: Complexes,
    bands: Integers,
    noise: Floats,
) -> PeriodicModel:
    """The periodic model of modes whose exponents and their covariance are known, its amplitudes by least squares.

    `others` are lines beside them that are no modes (lines,) [1/s], `bands` the harmonics that the model keeps of each
    mode (modes, 2), `noise` its deviation (channels, hits).
    """
    omega = entries.fundamental
    both = entries.joined(ModeParameters.made(others, (0, 0), omega, real=others.imag == 0.0, fixed=True)).joined(
        beside(omega)
    )
    blocks = after_phase_zero(raw, records, 2.0 * np.pi / omega)
    blocks = tuple(block.with_noise(noise[block.rows, block.hit]) for block in blocks)
    scale = np.sqrt(np.diag(covariance))
    information = np.linalg.inv(covariance / np.outer(scale, scale)) / np.outer(scale, scale)
    solution = replace(linearise(blocks, both), information=information, gauss_newton=information)
    kept = np.concatenate([bands, both.bands[len(bands) :]])
    provenance = Provenance.merge(tuple(record.provenance for record in records))
    return model_of(blocks, solution, kept, channels=records[0].channels, provenance=provenance, most=None)


def families_of(lines: Lines, groups: list[Group], average: Average) -> list[Family]:
    """The families with their lines as they were found."""
    std = np.sqrt(np.diag(average.covariance))
    turns = iter(std[len(groups) :])
    made = []
    for place, group in enumerate(groups):
        places = np.array(group.lines)
        real = group.half_turns is not None
        value = complex(average.exponents[place]) + 0.5j * (group.half_turns or 0) * average.fundamental
        made.append(
            Family(
                exponent=value,
                exponent_std=complex(std[place], 0.0 if real else next(turns)),
                lines=lines.exponents[places],
                line_std=lines.std[places],
                harmonics=np.array(group.harmonics),
                conjugated=np.array(group.signs) < 0,
            )
        )
    return made
