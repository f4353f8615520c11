"""Finding on a channel that is a weighted sum of others, noise and all, from a fit and its records."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.findings import Finding, warning
from floquid.fit import QUIET
from floquid.periodic import unexplained
from floquid.pipeline._analysis import Analysis
from floquid.preparation import NO_NEWS, name_of

OWN = 0.1
"""Share of its noise that a channel has beside the others, below which it has none of its own: 1 % of its power."""

COPIED = 0.04  # the same below which it is a copy, up to rounding; above, sensors may share what they do not measure


def of_sums(found: Analysis) -> tuple[Finding, ...]:
    """Finding on a channel that shares its noise with others; refused if it has next to none of its own.

    Too low an order leaves modes in what is taken for noise, which are alike in channels that are independent: where
    the order was given, nothing is refused. Noise that the structure itself makes is shared, too. What a model that
    fails leaves is no noise at all.
    """
    if found.failed:
        return ()
    own = _sum_of_others(found)
    if own is None:
        return ()
    if found.settings.order is None and own["beside"] < COPIED:
        must, remedy = "be independent measurements", f"Leave it out with `channels=`: {NO_NEWS}"
        raise input_error("records", "identify", must, warning("copied_sum", **own).clause, remedy)
    return (warning("sum_of_others", **own),)


def _sum_of_others(analysis: Analysis) -> dict[str, Any] | None:
    r"""A response that is a weighted sum of others, noise and all, its shares of them, and what it has beside them.

    .. math:: D^{-1} Y = L Q, \qquad |L_{kk}| / \sqrt{N - k} < 0.1

    with Y the responses (channels · hits, N samples), D their noise (of what the model leaves, without what is smooth),
    and L lower triangular: what a response has beside those before it, over its noise, is at least its own noise,
    unless it is a sum of the others. Records with hardly any noise are passed over: there, fewer modes than channels
    make sums of all of them. None where there is none.
    """
    records = analysis.responses
    left = unexplained(analysis.model, records, analysis.clocks)
    if len({record.sample_rate for record in records}) > 1:
        return None
    n = min(record.n_samples for record in records)
    rows = np.concatenate([record.values[:, :n] for record in records])
    rests = np.concatenate([own[:, :n] for own in left])
    there = np.isfinite(rests).all(axis=0)
    if there.sum() <= len(rows):
        return None
    if not there.all():
        rows, rests = rows[:, there], rests[:, there]
    noise = np.minimum(_noise_of(rests), _noise_of(rows))  # a wrong model leaves more than there is
    sizes = np.abs(rows).max(axis=1)
    if (noise <= QUIET * sizes).any():
        return None
    lower = np.asarray(np.linalg.qr((rows / noise[:, None]).T, mode="r")).T
    beside = np.abs(np.diag(lower)) / np.sqrt(rows.shape[1] - np.arange(len(rows)))
    if beside.min() >= OWN:
        return None
    first = int(np.flatnonzero(beside < OWN)[0])
    names = [name_of(c.name, hit, len(records)) for hit, r in enumerate(records, start=1) for c in r.channels]
    shares = np.linalg.solve(lower[:first, :first].T, lower[first, :first]) * noise[first] / noise[:first]
    own = [k for k in range(first) if abs(shares[k]) * sizes[k] > OWN * sizes[first]]
    others = [names[k] for k in own]
    return {"channel": names[first], "shares": shares[own], "others": others, "beside": float(beside[first])}


def _noise_of(rests: NDArray[np.float64]) -> NDArray[np.float64]:
    """The noise of samples that may hold a response too (rows,).

    Their root mean square, or what their median second difference is in white noise, if that is less.
    """
    from scipy.special import ndtri

    rough = np.abs(np.diff(rests, 2, axis=1))
    # The median size of a normal number is its upper quartile.
    rough = np.median(rough, axis=1) / (ndtri(0.75) * np.sqrt(6.0))
    return np.minimum(np.sqrt(np.einsum("rn,rn->r", rests, rests) / rests.shape[1]), rough)
