"""The modes of a periodic model fitted to lifted responses, their residues held to bands of harmonics."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from floquid._checks import Rebuilt, input_error
from floquid.core import PeriodicModel
from floquid.lifting import Lifted
from floquid.periodic._bands import Entries
from floquid.periodic._blocks import Block
from floquid.periodic._constrained import evaluated, settled
from floquid.periodic._final import LOOSE, PADDING, centred
from floquid.periodic._harmonics import GAP
from floquid.periodic._held import chosen_bands, model_of
from floquid.periodic._lifted_block import LiftedBlock
from floquid.periodic._residual import noise_left
from floquid.periodic._start import equal_multipliers
from floquid.periodic._state import State

ROUNDS = 4
"""How often bands may be chosen again."""


@dataclass(frozen=True, slots=True)
class Constrained(Rebuilt):
    """What the constrained fit gives.

    Parameters
    ----------
    model
        The periodic model.
    noise
        The deviation of what is left (channels, hits) [units of the channels].
    """

    model: PeriodicModel
    noise: NDArray[np.float64]


def constrain(model: PeriodicModel, lifted: Lifted, *, false_alarm: float = 1e-6, choose: bool = True) -> Constrained:
    r"""The model of the same modes, their residues held to their harmonics: exponents and coefficients anew.

    .. math:: y_{c,h}(t) = 2 \Re \sum_r \sum_{m \in M_r} B_{r,c,h,m}\, e^{(\lambda_r + i m \omega) t}

    (Allen 2009, eq. 12, the spacing ω enforced.) The bands M_r are chosen from the deviations of this fit; one harmonic
    more on each side is fitted and not reported.

    Parameters
    ----------
    model
        The periodic model of lifted responses.
    lifted
        The responses that it was found from.
    false_alarm
        The probability that noise passes for a harmonic of any mode.
    choose
        Whether bands are chosen; else they are those of the model.

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
        must, got = "be a model of `lifted`", f"it has {len(model.channels)} channels and {model.n_hits} hits"
        got += f", and the responses {lifted.n_channels} and {lifted.n_hits}"
        raise input_error("model", "constrain", must, got)
    if equal_multipliers(model):
        must, got = "have distinct multipliers", "two are equal, and residues that are free in each hit do not tell"
        remedy = "Keep the model as it is: `constrained=False`."
        raise input_error("model", "constrain", must, f"{got} their modes apart", remedy)
    most, blocks, entries = (lifted.n_phases - 1) // 2, LiftedBlock.all_of(lifted), Entries.of(model)
    if choose:
        state, bands = centred(*_with_own_bands(blocks, entries, most, false_alarm))
    else:
        state, bands = State(blocks, settled(blocks, entries)), entries.bands
    found = model_of(blocks, state.held, bands, channels=model.channels, provenance=model.provenance, most=most)
    return Constrained(found, noise_left(blocks, state.held))


def _with_own_bands(
    blocks: tuple[Block, ...], entries: Entries, most: int, false_alarm: float
) -> tuple[State, NDArray[np.int64]]:
    """The fit with bands chosen again by its own deviations until they stay, and those that rise above the noise.

    Of modes that fold onto one another free residues give each the harmonics of both. Fitted so, hardly any is told
    from zero: what is told is kept, and the others come back where they are needed.
    """
    found, bands = settled(blocks, entries.padded(PADDING, most)), entries.bands
    for _ in range(ROUNDS):
        wide = evaluated(blocks, replace(found.entries, bands=entries.bands).padded(GAP + 1, most))
        loose = chosen_bands(blocks, wide, LOOSE, each=True)
        bands = chosen_bands(blocks, wide, false_alarm)
        if (loose == entries.bands).all():
            break
        entries = replace(found.entries, bands=loose)
        found = settled(blocks, entries.padded(PADDING, most))
    return State(blocks, found), bands
