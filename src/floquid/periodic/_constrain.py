"""A periodic model finished by the constrained fit: bands, exponents, coefficients and their deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.core import PeriodicModel
from floquid.lifting import Lifted
from floquid.lti import fit_residues
from floquid.periodic._bands import Entries
from floquid.periodic._blocks import Block
from floquid.periodic._constrained import Held, evaluated, settled
from floquid.periodic._harmonics import GAP
from floquid.periodic._held import chosen_bands, model_of
from floquid.periodic._lifted_block import LiftedBlock

ROUNDS = 4
"""How often the bands may be chosen again."""

LOOSE = 0.2
"""The probability at which noise may pass for a harmonic that is fitted: one that is missing does more harm."""

PADDING = 1
"""Harmonics fitted beyond each end of a band: weak ones that are left out bend the exponents."""


@dataclass(frozen=True, slots=True)
class Constrained:
    """What the constrained fit gives.

    Parameters
    ----------
    model
        The periodic model.
    noise
        The deviation of what is left (channels, hits) [units of the channels].
    misfit
        How much more holding the residues leaves than noise explains, in standard deviations: beyond a few, a mode is
        several that fold onto one another, or has harmonics outside its band.
    entries
        What was fitted: modes with their bands.
    """

    model: PeriodicModel
    noise: NDArray[np.float64]
    misfit: float
    entries: Entries


def constrain(
    model: PeriodicModel, lifted: Lifted, *, false_alarm: float = 1e-6, choose: bool = True, padding: int = PADDING
) -> Constrained:
    r"""The model of the same modes, their residues held to their harmonics: exponents and coefficients anew.

    .. math:: y_{c,h}(t) = 2 \Re \sum_r \sum_{m \in M_r} B_{r,c,h,m}\, e^{(\lambda_r + i m \omega) t}

    (Allen 2009, eq. 12, the spacing ω enforced.) The bands M_r are those of the model, chosen again from the deviations
    of this fit until they stay; one harmonic more on each side is fitted and not reported.

    Parameters
    ----------
    model
        The periodic model of lifted responses.
    lifted
        The responses that it was found from.
    false_alarm
        The probability that noise passes for a harmonic of any mode.
    choose
        Whether bands are chosen again; else they are those of the model.
    padding
        Harmonics fitted beyond each end of a band.

    Returns
    -------
    Constrained
        The model, with deviations, and the noise left.

    Raises
    ------
    InputError
        The model is not one of these responses, or two of its multipliers are equal.
    IdentificationError
        There is no such fit near the model's exponents.
    """
    if (model.n_hits, len(model.channels)) != (lifted.n_hits, lifted.n_channels):
        raise input_error(
            "model",
            "constrain",
            "be a model of `lifted`",
            f"it has {len(model.channels)} channels and {model.n_hits} hits, and the responses "
            f"{lifted.n_channels} and {lifted.n_hits}",
        )
    if equal_multipliers(model):
        raise input_error(
            "model",
            "constrain",
            "have distinct multipliers",
            "two are equal, and residues that are free in each hit do not tell their modes apart",
            "Keep the model as it is: `constrained=False`.",
        )
    most, blocks = (lifted.n_phases - 1) // 2, LiftedBlock.all_of(lifted)
    found, bands = with_bands(blocks, Entries.of(model), most, false_alarm, choose=choose, padding=padding)
    held = model_of(blocks, found, bands, channels=model.channels, provenance=model.provenance, most=most)
    return Constrained(held, noise_left(blocks, found), excess(model, lifted, found), found.entries)


def equal_multipliers(model: PeriodicModel) -> bool:
    """Whether two modes share a multiplier."""
    gaps = np.abs(np.subtract.outer(model.multipliers, model.multipliers)) + np.eye(model.order)
    return bool((gaps < 1e-12).any())


def with_bands(
    blocks: Sequence[Block],
    entries: Entries,
    most: int,
    false_alarm: float,
    *,
    choose: bool = True,
    padding: int = PADDING,
) -> tuple[Held, NDArray[np.int64]]:
    """The fit with bands chosen again until they stay, and the bands that rise above the noise (entries, 2)."""
    bands, found = entries.bands, settled(blocks, entries.padded(padding, most))
    for _ in range(ROUNDS if choose else 0):
        wide = evaluated(blocks, replace(found.entries, bands=entries.bands).padded(GAP + 1, most))
        loose = chosen_bands(blocks, wide, LOOSE, each=True)
        bands = chosen_bands(blocks, wide, false_alarm)
        if (loose == entries.bands).all():
            break
        entries = replace(found.entries, bands=loose)
        found = settled(blocks, entries.padded(padding, most))
    return found, bands


def excess(model: PeriodicModel, lifted: Lifted, found: Held) -> float:
    r"""The rise of the cost over that of free residues, as a chi-square brought to zero mean and unit variance.

    .. math:: z = \frac{J_{\mathrm{held}} - J_{\mathrm{free}} - \nu}{\sqrt{2 \nu}}

    with ν the number of residues less that of coefficients; the free fit is at the model's own exponents.
    """
    free = fit_residues(model.multipliers, lifted.responses)
    assert free.residual_std is not None
    samples = np.maximum(lifted.responses.lengths - model.order, 0)
    cost = float(np.sum((free.residual_std / lifted.responses.noise) ** 2 * samples))
    coefficients = int(found.entries.sines().sum()) + len(found.entries.sines())
    residues = model.order * lifted.n_phases
    degrees = max((residues - coefficients) * lifted.n_channels * lifted.n_hits, 1)
    return (found.cost - cost - degrees) / np.sqrt(2.0 * degrees)


def noise_left(blocks: Sequence[Block], found: Held) -> NDArray[np.float64]:
    """The deviation of what is left (channels, hits), corrected for the parameters used."""
    columns = int(found.entries.sines().sum()) + len(found.entries.sines())
    squares = np.zeros((1 + max(int(b.rows.max()) for b in blocks), 1 + max(b.hit for b in blocks)))
    free = np.zeros(squares.shape)
    for block, linear in zip(blocks, found.linear, strict=True):
        squares[block.rows, block.hit] += linear.left
        free[block.rows, block.hit] += max(block.n_samples - columns, 1)
    return np.sqrt(squares / np.maximum(free, 1.0))
