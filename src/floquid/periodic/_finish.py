"""The end of an identification by lifting: residues held to their harmonics, and modes that lifting merged."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from floquid.core import PeriodicModel
from floquid.errors import FloquidError, IdentificationError
from floquid.lifting import Lifted
from floquid.periodic._constrain import Constrained, constrain, equal_multipliers, excess
from floquid.periodic._constrained import evaluated
from floquid.periodic._evidence import evidence
from floquid.periodic._held import model_of
from floquid.periodic._lifted_block import LiftedBlock
from floquid.periodic._search import Searched, forced_entries, searched
from floquid.periodic._trial import Limits, criterion

MISFIT = 6.0
"""Standard deviations of what held residues leave at which they are doubted, and merged modes looked for."""

CONFIDENT = 2e-3
"""A mode counts as well determined when both parts of its exponent have a deviation below this share of ω: one that is
not may stand for several."""


@dataclass(frozen=True, slots=True)
class Finished:
    """The end of an identification.

    Parameters
    ----------
    model
        The periodic model.
    held
        Whether its residues are held to their harmonics.
    misfit
        What they leave beyond noise, in standard deviations; zero where they are free.
    reasons, doubts
        What speaks for its modes and against them where they are others than lifting found; None where they are not.
    """

    model: PeriodicModel
    held: bool
    misfit: float
    reasons: tuple[str, ...] | None = None
    doubts: tuple[str, ...] = ()


def finish(
    model: PeriodicModel,
    lifted: Lifted,
    *,
    false_alarm: float = 1e-6,
    mode_false_alarm: float = 1e-9,
    choose: bool = True,
    search: bool = True,
    report: Callable[[str], None] = lambda _: None,
) -> Finished:
    """The model with residues held to their harmonics, and with the modes that lifting could not tell apart.

    Modes fold onto one another in lifted responses, and one that folds onto its own conjugate looks like two real
    multipliers. Where a mode is weakly determined, or held residues leave more than noise, modes are looked for anew at
    their unfolded frequencies (`fit`), and the better of the two is kept.

    Parameters
    ----------
    model
        The periodic model of the lifted responses.
    lifted
        The responses.
    false_alarm
        The probability that noise passes for a harmonic of any mode.
    mode_false_alarm
        The probability at which noise may pass for a mode.
    choose
        Whether bands are chosen again; else they are those of the model.
    search
        Whether modes may be looked for anew.
    report
        Is told of each stage.

    Returns
    -------
    Finished
        The model; that of lifting where holding the residues is not possible.
    """
    held: Constrained | None = None
    if equal_multipliers(model):
        return Finished(model, False, 0.0)  # free in each hit, residues do not tell such modes apart
    with suppress(IdentificationError, np.linalg.LinAlgError):
        held = constrain(model, lifted, false_alarm=false_alarm, choose=choose, padding=1 if choose else 0)
    plain = Finished(model, False, 0.0) if held is None else Finished(held.model, True, held.misfit)
    if not (search and choose) or (held is not None and held.misfit < MISFIT and not _weak(held.model)):
        return plain
    report("looking for modes that fold onto one another")
    limits = Limits(
        most=(lifted.n_phases - 1) // 2,
        modes=model.order + 8,
        mode_alarm=mode_false_alarm,
        harmonic_alarm=false_alarm,
        forced=np.zeros(0),
    )
    with suppress(FloquidError, np.linalg.LinAlgError):
        found = searched(LiftedBlock.all_of(lifted), forced_entries([], model.fundamental), limits, report)
        return _better(plain, held, found, lifted)
    return plain


def _better(plain: Finished, held: Constrained | None, found: Searched, lifted: Lifted) -> Finished:
    """What a search found, if it explains the responses better than the model that there was."""
    anew = evaluated(found.blocks, found.held.entries)
    if not len(anew.entries.exponents):
        return plain
    other = model_of(
        found.blocks,
        found.held,
        found.bands,
        channels=plain.model.channels,
        provenance=plain.model.provenance,
        most=(lifted.n_phases - 1) // 2,
    )
    left = excess(other, lifted, evaluated(LiftedBlock.all_of(lifted), found.held.entries))
    if held is None:
        return plain if left > MISFIT else Finished(other, True, left, *evidence(found))
    before = evaluated(found.blocks, held.entries)
    if criterion(found.blocks, anew) >= criterion(found.blocks, before):
        return plain
    return Finished(other, True, left, *evidence(found))


def _weak(model: PeriodicModel) -> bool:
    """Whether a mode is so weakly determined that it may stand for several."""
    std = model.exponent_std
    return (
        std is not None
        and model.order > 0
        and float(np.maximum(std.real, std.imag).max()) > CONFIDENT * model.fundamental
    )
