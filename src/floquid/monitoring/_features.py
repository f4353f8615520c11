"""Features of records: parts of the exponents of modes, and their change by a damage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Floats, Mask
from floquid._checks import counted, input_error
from floquid.monitoring._baseline import Baseline
from floquid.monitoring._work import OF, Work, file_of
from floquid.surveys import Matches

COMMON = 0.5  # share of the baseline's records that a mode must be found in


@dataclass(frozen=True, slots=True, kw_only=True)
class Features:
    """Parts of exponents (records, features), with their covariance at each record."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    covariance: Floats


def common(matches: Matches, healthy: Mask, warnings: list[str]) -> Matches:
    """The modes that at least half of the `healthy` records with a result have; others are told."""
    known = np.isfinite(matches.exponents)
    usable = known[: len(healthy)].any(axis=1) & healthy
    share = known[: len(healthy)][usable].mean(axis=0) if usable.any() else np.zeros(known.shape[1])
    rare = np.flatnonzero((share < COMMON) & known.any(axis=0))
    if len(rare):
        hertz = np.nanmedian(np.abs(matches.exponents[:, rare].imag), axis=0) / (2.0 * np.pi)
        words = ", ".join(f"{own:.4g}" for own in hertz)
        warnings.append(f"Modes in less than half of the baseline are left out: {words} Hz.")
    kept = share >= COMMON
    names = ("exponents", "modes", "shifts", "mirrored")
    return Matches(**{name: getattr(matches, name)[:, kept] for name in names})


def features_of(work: Work) -> Features:
    """Parts of the exponents of the modes; those without deviations, as of real multipliers one, are none."""
    exponents, covariance = work.matches.exponents, work.matches.covariance(work.every)
    count = exponents.shape[1]
    usable = np.flatnonzero(work.healthy & np.isfinite(exponents[: len(work.points)]).any(axis=1))
    names, units, parts = [], [], []
    for mode in range(count):
        for part, word, unit in ((mode, "decay", "1/s"), (mode + count, "frequency", "rad/s")):
            if np.nanmin(covariance[usable, part, part]) > 0.0:
                names.append(f"mode {mode + 1} {word}")
                units.append(unit)
                parts.append(part)
    if not parts:
        got = f"have none in common, with {counted(len(usable), 'result')} that can be used"
        remedy = "Identify them with deviations, and look at the reasons of those that fail."
        raise input_error("results", OF, "have modes with deviations in the baseline", got, remedy)
    both = np.concatenate([exponents.real, exponents.imag], axis=1)[:, parts]
    return Features(names=tuple(names), units=tuple(units), values=both, covariance=covariance[:, parts][:, :, parts])


def tell_missing(values: Floats, healthy: Mask, names: Sequence[str], warnings: list[str]) -> None:
    """Tell of modes that are missing more often than in the baseline: that is a change that no chart shows."""
    later = ~healthy & np.isfinite(values).any(axis=1)
    for column, name in enumerate(names):
        if not name.endswith("decay") or not later.any():
            continue
        before, after = (int((~np.isfinite(values[rows, column])).sum()) for rows in (healthy, later))
        share, total = (before + 1.0) / (healthy.sum() + 2.0), int(later.sum())
        if after > total * share + 4.0 * np.sqrt(total * share * (1.0 - share)):
            mode = name.rpartition(" ")[0]
            warnings.append(f"{mode} is missing in {after} of {total} later records, and in {before} of the baseline.")


def direction_of(work: Work, features: Features, base: Baseline) -> Floats | None:
    """The change of the features by a damage (features,)."""
    if work.along is not None:
        if work.along.shape != (len(features.names),) or not work.along.any():
            must = f"hold the changes of the {len(features.names)} features ({', '.join(features.names)})"
            raise input_error("direction", OF, must, f"has the shape {work.along.shape}")
        return work.along
    if not work.labelled:
        return None
    rows = features.values[len(work.points) :]
    damaged, which = rows[-1], work.labelled[-1]
    if len(rows) > 1:
        return np.nan_to_num(damaged - rows[0])
    varying = work.varying(work.healthy)
    own = np.array([[which.values.get(name, np.nan) for name in work.names]])[:, varying]
    if not np.isfinite(own).all() or not np.isfinite(damaged).any():
        must, got = "have the covariates and modes of the baseline", f"{file_of(which)} has not"
        raise input_error("direction", OF, must, got, "Identify it as the other records, with its operating point.")
    return np.nan_to_num(damaged - base.regression.predicted(base.columns(own))[0])
