"""Second-order states from displacement, velocity or acceleration channels (Allen 2009, eqs. 13-21 as corrected)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._checks import frozen_array, input_error
from floquid.core import PeriodicModel, channels_named
from floquid.errors import IdentificationError
from floquid.reconstruction._state_model import StateModel

LARGEST_CONDITION = 1e8
"""The condition number of the equilibrated modal matrix beyond which its inverse is noise."""

_DERIVATIVES = {"displacement": 0, "velocity": 1, "acceleration": 2}


def reconstruct(model: PeriodicModel, states: Sequence[str], *, times: ArrayLike | int = 50) -> StateModel:
    r"""The state transition matrix and the state matrix with the chosen channels as displacement states.

    With s = λ_r + imω and B the coefficients of the displacements (those of a velocity channel over s, of an
    acceleration channel over s²), the modal matrix has the columns

    .. math:: \psi_r(t) = \sum_m \begin{bmatrix} B_{r,m} \\ s\,B_{r,m} \end{bmatrix} e^{i m \omega t}

    and

    .. math:: \Phi(t, t_0) = \Psi(t)\, e^{\Lambda (t - t_0)}\, \Psi(t_0)^{-1}, \qquad
              A(t) = (\dot\Psi + \Psi\Lambda)\, \Psi^{-1}

    (Allen 2009, eqs. 13-21; the factor s belongs to the velocity half alone, and the Vandermonde matrix of eqs. 16-19
    cancels: L(t0) = Ψ(t0)⁻¹ exactly.) Several hits give one shape a mode, up to a factor that cancels too: the leading
    singular vector over the hits.

    Parameters
    ----------
    model
        The identified response model; it must have twice as many modes as there are states chosen.
    states
        Names of the channels taken as displacement states (E in eq. 13).
    times
        Instants after phase zero [s], or how many equally spaced ones over a period.

    Returns
    -------
    StateModel
        Displacements first, then velocities.

    Raises
    ------
    InputError
        A channel is unknown, is not a motion, or the channels chosen cannot span the modes.
    IdentificationError
        The shapes of the modes in the chosen channels are linearly dependent.
    """
    if isinstance(times, (int, np.integer)):
        instants = np.arange(int(times)) * model.period / max(int(times), 1)
    else:
        instants = frozen_array(times, "times", "reconstruct", axes=("times",))
    if not len(instants):
        raise input_error("times", "reconstruct", "hold at least one instant", f"is {times!r}")
    rows = _chosen(model, states)
    slopes = model.exponents[:, None] + 1j * model.harmonics * model.fundamental
    shapes = _displacements(model, rows, slopes)
    phases = np.exp(1j * model.fundamental * np.multiply.outer(model.harmonics, instants))
    powers = [np.einsum("rcm,rm,mt->tcr", shapes, slopes**p, phases) for p in range(3)]
    modal = np.concatenate([powers[0], powers[1]], axis=1)
    # d/dt(Ψ e^{Λt}) e^{-Λt} = Ψ' + ΨΛ: each coefficient times its own s once more.
    moved = np.concatenate([powers[1], powers[2]], axis=1)
    row_scale = np.sqrt(np.mean(np.abs(modal) ** 2, axis=(0, 2)))
    if (row_scale == 0).any():
        raise IdentificationError("A state chosen has no part in any mode: choose other channels with `states`.")
    scaled = modal / row_scale[:, None]
    column_scale = np.linalg.norm(scaled, axis=1, keepdims=True)
    equilibrated = scaled / np.where(column_scale > 0, column_scale, 1.0)
    condition = np.linalg.cond(equilibrated)
    if not (condition < LARGEST_CONDITION).all():
        raise IdentificationError(
            f"The modes' shapes in {', '.join(states)} are linearly dependent (condition number {condition.max():.1e} "
            "of the modal matrix): A(t) in these states would be noise. Choose other channels with `states`."
        )
    inverse = np.linalg.inv(modal)
    growth = np.exp(np.multiply.outer(instants - instants[0], model.exponents))
    transition = (modal * growth[:, None, :]) @ inverse[0]
    names = [model.channels[row].name for row in rows]
    return StateModel(
        times=instants,
        transition=transition.real,
        system=(moved @ inverse).real,
        condition=condition,
        states=(*names, *(f"d/dt {name}" for name in names)),
        provenance=model.provenance.then(f"state matrix in second-order form from {', '.join(names)}"),
    )


def _chosen(model: PeriodicModel, states: Sequence[str]) -> list[int]:
    """The rows of the chosen channels, when they are motions that can span the modes."""
    rows = channels_named(model.channels, states, argument="states", of="reconstruct")
    for row in rows:
        channel = model.channels[row]
        if channel.quantity not in _DERIVATIVES:
            raise input_error(
                "states",
                "reconstruct",
                "name channels of displacement, velocity or acceleration",
                f"channel {channel.name!r} measures {channel.quantity} [{channel.unit}]",
                "Choose motions, or give the channel its quantity.",
            )
    if model.order % 2:
        raise input_error(
            "model",
            "reconstruct",
            "have an even number of modes: a channel gives two states, displacement and velocity",
            f"has {model.order}",
            "Identify again with an even `order`, or leave A(t) out.",
        )
    if 2 * len(rows) != model.order:
        needed = model.order // 2
        raise input_error(
            "states",
            "reconstruct",
            f"name {needed} channels: {model.order} modes (conjugates one by one) need as many states, half of them "
            "velocities",
            f"names {len(rows)}",
            f"The channels are: {', '.join(c.name for c in model.channels)}."
            + (" There are too few of them to span these modes." if needed > len(model.channels) else ""),
        )
    return rows


def _displacements(model: PeriodicModel, rows: list[int], slopes: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """One displacement shape a mode (modes, states, harmonics), the hits combined."""
    combined = np.zeros((model.order, len(model.channels), len(model.harmonics)), complex)
    weight = _channel_weights(model)
    for r in range(model.order):
        block = (model.coefficients[r] * weight[:, None, None]).transpose(0, 2, 1).reshape(-1, model.n_hits)
        _, _, right = np.linalg.svd(block, full_matrices=False)
        combined[r] = np.einsum("chm,h->cm", model.coefficients[r], right[0].conj())
    derivatives = np.array([_DERIVATIVES[str(model.channels[row].quantity)] for row in rows])
    if derivatives.any() and (slopes == 0).any():
        raise IdentificationError(
            "A mode has a harmonic at zero frequency and no decay: its displacement is not in the record."
        )
    # An index of zero leaves the coefficients of a displacement channel as they are.
    return combined[:, rows] / slopes[:, None, :] ** derivatives[None, :, None]


def _channel_weights(model: PeriodicModel) -> NDArray[np.float64]:
    """Weights that make the noise of the channels equal, or their sizes where no noise is known."""
    reference = model.coefficients if model.coefficient_std is None else model.coefficient_std
    size = np.sqrt(np.max(np.abs(reference) ** 2, axis=(0, 2, 3)))
    return np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
