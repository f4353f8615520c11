"""Periodic subspaces: one routine, of which the methods of the literature are configurations.

Signals are windows (channels, columns, length), the columns being periods or experiments of one phase.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def by_periods(signal: Floats, phases: int, length: int) -> Floats:
    """Windows of a record that begin a period after one another; of one phase they are all there are."""
    return np.lib.stride_tricks.sliding_window_view(signal, length, axis=1)[:, ::phases]


def rows(windows: Floats, first: int, depth: int) -> Floats:
    """Block rows of samples from `first` on (depth · channels, columns)."""
    return np.moveaxis(windows[:, :, first : first + depth], 2, 0).reshape(-1, windows.shape[1])


def observability(outputs: Floats, inputs: Floats, first: int, depth: int, order: int) -> Floats:
    """Γ of the phase of sample `first` + depth, by the past as instrument (PI-MOESP; Verhaegen and Yu 1995).

    Future outputs less what future inputs explain, projected on the past: singular vectors of that block of an LQ.
    """
    future, past = rows(inputs, first + depth, depth), rows(inputs, first, depth)
    stacked = np.concatenate([future, past, rows(outputs, first, depth), rows(outputs, first + depth, depth)])
    if stacked.shape[1] < len(stacked):
        raise ValueError(f"{stacked.shape[1]} columns for {len(stacked)} rows")
    lower = np.linalg.qr(stacked.T, mode="r").T
    last = depth * len(outputs)
    block = lower[-last:, len(future) : len(stacked) - last]
    return np.linalg.svd(block, full_matrices=False)[0][:, :order]


def multipliers(outputs: Floats, inputs: Floats, phases: int, depth: int, order: int) -> NDArray[np.complex128]:
    """Eigenvalues of A_{P-1} … A_0, A_k = Γ_{k+1}⁺ Γ_k shifted by a sample, of windows of P + 2 depth samples."""
    count = len(outputs)
    seen = [observability(outputs, inputs, phase, depth, order) for phase in range(phases)]
    whole = np.eye(order)
    for own, after in zip(seen, [*seen[1:], seen[0]], strict=True):
        whole = np.linalg.lstsq(after[:-count], own[count:], rcond=None)[0] @ whole
    return np.linalg.eigvals(whole).astype(complex)


def cycled(signal: Floats, phases: int) -> Floats:
    """Each sample in the rows of its phase, zero elsewhere (phases · channels, samples) (Okajima 2025)."""
    found = np.zeros((phases, *signal.shape))
    for phase in range(phases):
        found[phase, :, phase::phases] = signal[:, phase::phases]
    return found.reshape(-1, signal.shape[1])


def gathered(values: NDArray[np.complex128], copies: int) -> NDArray[np.complex128]:
    """Means of values that come in so many copies each."""
    found, left = [], values
    while len(left) >= copies:
        near = np.argsort(np.abs(left - left[np.argmax(np.abs(left.imag))]))
        found.append(left[near[:copies]].mean())
        left = left[near[copies:]]
    return np.array(found)


def predictor_multipliers(
    outputs: Floats, inputs: Floats, phases: int, past: int, future: int, order: int
) -> NDArray[np.complex128]:
    """The same by the predictor form, so that a loop may be closed (Felici, van Wingerden and Verhaegen 2007).

    Each phase has its own coefficients of the past in the prediction of y; those of later phases, shifted, are rows of
    Γ K, whose product with the past has the states; A_k and B_k are fitted to these. Windows of P + past + future.
    """
    signals = np.concatenate([inputs, outputs])
    width = len(signals)
    if past * width > signals.shape[1]:
        raise ValueError(f"{signals.shape[1]} columns for {past * width} rows")
    regressors = [rows(signals, phase, past) for phase in range(phases + 1)]
    thetas, errors = [], []
    for phase in range(phases):
        now = outputs[:, :, phase + past]
        thetas.append(np.linalg.lstsq(regressors[phase].T, now.T, rcond=None)[0].T)
        errors.append(now - thetas[-1] @ regressors[phase])
    to_states = []
    for phase in range(phases):
        seen = np.zeros((future * len(outputs), past * width))
        for ahead in range(future):
            theta = thetas[(phase + ahead) % phases]
            own = slice(ahead * len(outputs), (ahead + 1) * len(outputs))
            seen[own, ahead * width :] = theta[:, : (past - ahead) * width]
        left = np.linalg.svd(seen @ regressors[phase], full_matrices=False)[0][:, :order]
        to_states.append(left.T @ seen)
    whole = np.eye(order)
    for phase in range(phases):
        state, after = (to_states[k % phases] @ regressors[k] for k in (phase, phase + 1))
        known = np.concatenate([state, inputs[:, :, phase + past], errors[phase]])
        whole = np.linalg.lstsq(known.T, after.T, rcond=None)[0].T[:, :order] @ whole
    return np.linalg.eigvals(whole).astype(complex)
