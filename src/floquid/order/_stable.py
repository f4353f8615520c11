"""Which poles stay where they are when the order changes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from floquid._checks import input_error
from floquid.lti import ModalModel
from floquid.order._types import Stability, Tolerances

FAR = 10.0
"""The misfit, in tolerances, beyond which two poles are just as far: one that is lost pushes no other off its match."""

DEFAULT = Tolerances()


def mac(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> NDArray[np.float64]:
    """|aᴴb|²/(aᴴa · bᴴb) for each row of `a` (m, entries) and of `b` (n, entries): (m, n); 0 where one is zero."""
    lengths = np.outer(np.sum(np.abs(a) ** 2, axis=1), np.sum(np.abs(b) ** 2, axis=1))
    cross = np.abs(a.conj() @ b.T) ** 2
    return np.divide(cross, lengths, out=np.zeros_like(cross), where=lengths > 0)


def paired(misfit: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The rows and columns that belong together: the assignment of the least total misfit."""
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(misfit)
    return rows, columns


def stability(
    model: ModalModel,
    lower: ModalModel,
    *,
    noise: NDArray[np.float64] | None = None,
    tolerances: Tolerances = DEFAULT,
) -> NDArray[np.int64]:
    r"""The `Stability` of each pole (modes,): how far it agrees with one of a lower order.

    .. math:: |\theta_a - \theta_b|_{2\pi} \le 2\pi f, \qquad |d_a - d_b| \le \max(\epsilon\, d, d_0), \qquad
              \frac{|R_a^H R_b|^2}{(R_a^H R_a)(R_b^H R_b)} \ge m

    with μ = exp(-d + iθ) and R the residues over their noise, all outputs and inputs in one vector. Poles are paired
    one to one by the least total misfit, angles going round at π. Real multipliers pair with real ones of their sign;
    they have no frequency, and their decay alone is compared.

    Gates on the shape itself that are common elsewhere, such as the modal phase collinearity or the mean phase
    deviation, are not used: the shapes of lifted responses are fully complex, and every true mode would be rejected.

    Parameters
    ----------
    model
        The model whose poles are judged.
    lower
        The model of the next lower order, of the same responses.
    noise
        The standard deviation of the noise on each response (outputs, inputs); alike where not given.
    tolerances
        When two poles count as one.

    Raises
    ------
    InputError
        The models are not of the same responses.
    """
    if model.residues.shape[1:] != lower.residues.shape[1:]:
        must, got = "be of the same responses", f"has {lower.residues.shape[1:]} instead of {model.residues.shape[1:]}"
        raise input_error("lower", "stability", must, got, "Both models must come from one scan.")
    levels = np.zeros(model.order, dtype=np.int64)
    if not model.order or not lower.order:
        return levels
    weight = 1.0 if noise is None else 1.0 / noise
    shapes = [(one.residues * weight).reshape(one.order, -1) for one in (model, lower)]
    turn, decay = _misfits(model.multipliers, lower.multipliers, tolerances)
    shape = (1.0 - mac(*shapes)) / (1.0 - tolerances.shape)
    misfits = np.stack([turn, decay, shape])
    rows, columns = paired(np.minimum(misfits, FAR).sum(axis=0))
    met = misfits[:, rows, columns] <= 1.0
    levels[rows] = np.cumprod(met, axis=0).sum(axis=0)
    # Equal angles of real multipliers say nothing by themselves.
    real = model.multipliers[rows].imag == 0
    levels[rows[real & (levels[rows] == Stability.FREQUENCY)]] = Stability.NEW
    return levels


def _misfits(
    here: NDArray[np.complex128], there: NDArray[np.complex128], tolerances: Tolerances
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The differences of the angles and of the decays in tolerances (m, n); infinite between unlike kinds."""
    tiny = np.finfo(float).tiny
    a, b = (np.asarray(np.log(np.where(np.abs(mu) < tiny, tiny, mu)), dtype=np.complex128) for mu in (here, there))
    larger = np.maximum(np.abs(a.real)[:, None], np.abs(b.real))
    wrapped = np.mod(np.subtract.outer(a.imag, b.imag) + np.pi, 2.0 * np.pi) - np.pi
    turn = np.abs(wrapped) / np.maximum(2.0 * np.pi * tolerances.frequency, tolerances.damping * larger)
    decay = np.abs(np.subtract.outer(a.real, b.real)) / np.maximum(tolerances.damping * larger, tolerances.decay)
    unlike = np.not_equal.outer(here.imag == 0, there.imag == 0)
    return np.where(unlike, np.inf, turn), np.where(unlike, np.inf, decay)
