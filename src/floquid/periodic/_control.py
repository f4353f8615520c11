"""Periodic models to and from python-control: the lifted response is that of a time-invariant system."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from floquid._arrays import Complexes, Floats
from floquid._checks import describe, finite, input_error, integer, noise_array, positive
from floquid.core import Channel, PeriodicModel, Provenance
from floquid.io import load_package
from floquid.lifting import Lifted
from floquid.lti import ModalModel, TimeResponses
from floquid.periodic.expansion import assemble

if TYPE_CHECKING:
    from control import StateSpace

EQUAL = 1e-8  # relative distance within which multipliers are one: several hits on one mode give it several states
ROUNDING = 1e-12  # share of the largest below which a residue or a coefficient is rounding


def to_control(model: PeriodicModel, n_phases: int, *, first_phase: float = 0.0) -> StateSpace:
    r"""The lifted free response of a model as a discrete-time system of python-control, of one step a period.

    .. math:: x_{n+1} = A x_n + B u_n, \qquad y_n = C x_n + D u_n, \qquad
              D = y(t_0, \ldots, t_{P-1}), \quad C A^{n-1} B = y(nT + t_0, \ldots)

    so that the response to a unit impulse in input h is the free response of hit h at all phases, period by period. The
    poles are the multipliers. All matrices are real: a real multiplier has one state, a pair of conjugates has two, its
    real and imaginary part, once for each of the hits that are independent in it.

    Outputs are `X[0]`, `X[1]`, ..., by channel, then phase (a full stop in a name is a middle dot, which python-control
    allows), inputs are `hit1`, ..., and dt is the period [s]. Raises InputError where python-control is not installed,
    or an argument is not possible. `model` is the periodic model, and `n_phases` are the phases a period, P: all of it
    is kept, and `from_control` gives it back, while no frequency Im λ + mω lies beyond P/2 fundamentals. `first_phase`
    is the phase of the first of them, in periods.
    """
    of = "periodic.to_control"
    if not isinstance(model, PeriodicModel):
        got = f"is {describe(model)}"
        raise input_error("model", of, "be a PeriodicModel", got, "Of an analysis pass `analysis.model`.")
    phases = integer(n_phases, "n_phases", of, at_least=1)
    times = (finite(first_phase, "first_phase", of) + np.arange(phases) / phases) * model.period
    made = load_package("control", of).StateSpace
    blocks = [_real_block(*parts) for parts in _by_multiplier(model, times)]
    count = sum(len(block.A) for block in blocks)
    A, place = np.zeros((count, count)), 0
    for block in blocks:
        own = slice(place, place + len(block.A))
        A[own, own] = block.A
        place = own.stop
    n_outputs = len(model.channels) * phases
    start = np.concatenate([np.zeros((0, model.n_hits)), *(block.start for block in blocks)])
    C = np.concatenate([np.zeros((n_outputs, 0)), *(block.C for block in blocks)], axis=1)
    return made(
        A,
        A @ start,
        C,
        C @ start,
        model.period,
        inputs=[f"hit{hit + 1}" for hit in range(model.n_hits)],
        outputs=[f"{_word(channel.name)}[{phase}]" for channel in model.channels for phase in range(phases)],
        states=[f"x{state + 1}" for state in range(count)],
    )


def from_control(
    system: StateSpace,
    channels: Sequence[Channel | str],
    *,
    first_phase: float = 0.0,
    noise: ArrayLike | None = None,
    tolerance: float = 1e-6,
) -> PeriodicModel:
    r"""The periodic model whose lifted free response is the impulse response of a system of python-control.

    The inverse of `to_control`: modes are the eigenvalues of A, those of several equal ones put together, and their
    residues :math:`R_r = C v_r w_r^T B/\mu_r` are expanded over the phases by `assemble`.

    It has no deviations, and the harmonics that are more than rounding. Raises InputError where the system is of
    continuous time or of a step that is no period, has a pole at zero or repeated poles with fewer eigenvectors, or its
    D is not that of a free response; the outputs are no whole number of phases a channel, or too few phases for the
    harmonics.

    Parameters
    ----------
    system
        A discrete-time system whose step is the period: `control.ss(A, B, C, D, period)`.
    channels
        One a block of phases, or their names; the phases a period are the outputs over the channels. Outputs that are
        all called `X[0]`, `X[1]`, ... by these channels are taken in whichever order, others by channel, then phase.
    first_phase
        The phase of the first output of each channel, in periods.
    noise
        The standard deviation of the noise of each channel (channels,) [units of the channels], by which `assemble`
        weights them; by default the largest value of each.
    tolerance
        The share of a channel's largest value to which D, C A⁻¹ B and the model must agree on the first period: small
        where the system is exact, and as large as the noise where it was realised from responses with noise.
    """
    of = "periodic.from_control"
    made = load_package("control", of).StateSpace
    if not isinstance(system, made):
        raise input_error("system", of, "be a control.StateSpace", f"is {describe(system)}", "Use `control.ss`.")
    period = _period(system, of)
    named = tuple(c if isinstance(c, Channel) else Channel(name=str(c)) for c in channels)
    order = _order_of_outputs(list(system.output_labels), [c.name for c in named], of)
    C, D = np.asarray(system.C, float)[order], np.asarray(system.D, float)[order]
    if not D.size:
        raise input_error("system", of, "have an output and an input", f"has D of shape {D.shape}")
    sizes = np.abs(D).reshape(len(named), -1).max(axis=1)
    spread = np.where(sizes > 0, sizes, 1.0) if noise is None else noise_array(noise, of, (len(named),), remedy="")
    scale = np.repeat(np.where(sizes > 0, sizes, 1.0), len(order) // len(named))[:, None]
    multipliers, residues = _modes(np.asarray(system.A, float), np.asarray(system.B, float), C, scale, of)
    allowed = positive(tolerance, "tolerance", of)
    _check_first_period(D, residues, scale, allowed, of)
    n_phases = len(order) // len(named)
    noise_of_outputs = np.repeat(np.broadcast_to(spread[:, None], (len(named), D.shape[1])), n_phases, axis=0)
    lifted = Lifted(
        responses=TimeResponses(values=D[:, :, None], dt=period, noise=noise_of_outputs),
        channels=named,
        n_phases=n_phases,
        first_phase=finite(first_phase, "first_phase", of),
        provenance=Provenance(sources=("a control.StateSpace",)),
    )
    modal = ModalModel(multipliers=multipliers, residues=residues, dt=period)
    model = _without_rounding(assemble(modal, lifted, harmonics=(n_phases - 1) // 2), spread)
    _check_harmonics(model, lifted, residues, scale, allowed, of)
    return model


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Block:
    """States of one multiplier: z[n+1] = A z[n], y[n] = C z[n], from `start` (states, hits)."""

    A: NDArray[np.floating]
    C: NDArray[np.floating]
    start: NDArray[np.floating]


def _by_multiplier(model: PeriodicModel, times: Floats) -> list[tuple[complex, Complexes]]:
    """Distinct multipliers that are real or above the real axis, and their residues (outputs, hits)."""
    lifted = model.shapes(times) * np.exp(np.multiply.outer(model.exponents, times))[:, None, None, :]
    residues = np.moveaxis(lifted, 3, 2).reshape(model.order, -1, model.n_hits)
    return _together(model.multipliers, residues)


def _together(multipliers: Complexes, residues: Complexes) -> list[tuple[complex, Complexes]]:
    """Equal multipliers as one, whose residue is the sum; of conjugates the one above the real axis alone."""
    found: list[tuple[complex, Complexes]] = []
    for mu, residue in zip(multipliers, residues, strict=True):
        real = abs(mu.imag) <= EQUAL * abs(mu)
        if mu.imag < 0 and not real:
            continue
        own = complex(mu.real, 0.0) if real else complex(mu)
        part = residue.real + 0j if real else residue
        same = next((k for k, (other, _) in enumerate(found) if abs(own - other) <= EQUAL * abs(other)), None)
        if same is None:
            found.append((own, part))
        else:
            found[same] = (found[same][0], found[same][1] + part)
    return found


def _real_block(multiplier: complex, residue: Complexes) -> _Block:
    """A real system whose free response is that of one multiplier and its conjugate, as small as can be."""
    left, size, right = np.linalg.svd(residue.real if multiplier.imag == 0.0 else residue, full_matrices=False)
    rank = int(np.sum(size > ROUNDING * size.max(initial=0.0)))
    exits = np.asarray(left[:, :rank] * np.sqrt(size[:rank]), np.complex128)
    start = np.asarray(right[:rank] * np.sqrt(size[:rank, None]), np.complex128)
    if multiplier.imag == 0.0:
        return _Block(A=np.diag(np.full(rank, multiplier.real)), C=exits.real, start=start.real)
    turn = np.array([[multiplier.real, -multiplier.imag], [multiplier.imag, multiplier.real]])
    # 2 Re(c z): the states are the real and the imaginary part of z
    return _Block(
        A=np.kron(np.eye(rank), turn),
        C=np.stack([2.0 * exits.real, -2.0 * exits.imag], axis=2).reshape(len(exits), -1),
        start=np.stack([start.real, start.imag], axis=1).reshape(-1, start.shape[1]),
    )


def _word(name: str) -> str:
    """A name as python-control takes it, which keeps the full stop for itself."""
    return name.replace(".", "·")


def _period(system: Any, of: str) -> float:
    """The step of the system, which must be stated."""
    dt = system.dt
    if dt is None or isinstance(dt, bool) or dt == 0:
        words = "of continuous time" if dt == 0 and not isinstance(dt, bool) else "of no stated step"
        remedy = "Its step is the period of the model: `control.ss(A, B, C, D, period)`."
        raise input_error("system", of, "be of discrete time, in steps of the period [s]", f"is {words}", remedy)
    return positive(float(dt), "system", of, unit="s")


def _order_of_outputs(labels: list[str], names: list[str], of: str) -> list[int]:
    """The outputs by channel, then phase: by their labels if these say so, or else as they are."""
    if not names or len(labels) % len(names):
        got = f"has {len(labels)} outputs for {len(names)} channels"
        raise input_error("system", of, "have as many outputs in each channel", got, "Name every channel.")
    n_phases = len(labels) // len(names)
    found = [re.fullmatch(r"(.*)\[(\d+)\]", label) for label in labels]
    said = {(match[1], int(match[2])): place for place, match in enumerate(found) if match}
    wanted = [(_word(name), phase) for name in names for phase in range(n_phases)]
    return [said[key] for key in wanted] if set(said) == set(wanted) else list(range(len(labels)))


def _modes(A: Floats, B: Floats, C: Floats, scale: Floats, of: str) -> tuple[Complexes, Complexes]:
    """The multipliers (modes,), conjugates beside each other, and their residues (modes, outputs, hits)."""
    values, vectors = (np.asarray(part, np.complex128) for part in np.linalg.eig(A))
    try:
        entry = np.linalg.solve(vectors, B.astype(np.complex128))
    except np.linalg.LinAlgError:
        entry = np.full((len(A), B.shape[1]), np.nan + 0j)
    exits = C @ vectors
    seconds = exits.T[:, :, None] * entry[:, None, :]  # what each mode gives the second period
    largest = np.abs(C @ B / scale).max(initial=0.0)
    off = np.abs((C @ A @ B - np.einsum("r,roi->oi", values, seconds)) / scale).max(initial=0.0)
    off = max(off, np.abs((C @ B - seconds.sum(axis=0)) / scale).max(initial=0.0))
    if not off <= 1e-9 * max(largest, np.abs(C @ A @ B / scale).max(initial=0.0)):
        must = "have as many eigenvectors of A as states"
        remedy = "No periodic model of separate modes has such a response: reduce it with `control.model_reduction`."
        raise input_error("system", of, must, "has repeated poles with fewer, or too near to one another", remedy)
    seen = np.abs(seconds / scale).max(axis=(1, 2), initial=0.0) > ROUNDING * largest
    if (np.abs(values[seen]) <= np.finfo(float).eps * np.abs(values).max(initial=0.0)).any():
        got = "has a pole at zero in its response"
        raise input_error("system", of, "have poles that an exponent belongs to", got, "Take the delays off.")
    found = _together(values[seen], seconds[seen] / values[seen, None, None])
    both = [(mu, r) for mu, r in found] + [(mu.conjugate(), r.conj()) for mu, r in found if mu.imag > 0]
    both.sort(key=lambda pair: (abs(np.angle(pair[0])), abs(pair[0]), -pair[0].imag))
    if not both:
        raise input_error("system", of, "have a mode that is seen", "has none in its response")
    return np.array([mu for mu, _ in both]), np.array([r for _, r in both])


def _check_first_period(D: Floats, residues: Complexes, scale: Floats, tolerance: float, of: str) -> None:
    off = float(np.abs((D - residues.sum(axis=0)) / scale).max())
    if off > tolerance:
        raise input_error(
            "system",
            of,
            "have the impulse response of a free one, from D on",
            f"has a D that is off by {off:.2g} of the largest value from C A⁻¹ B, as its modes have it",
            "The first period of each hit is in D, the next is C B; of responses with noise pass a larger `tolerance`.",
        )


def _without_rounding(model: PeriodicModel, noise: Floats) -> PeriodicModel:
    """The model without coefficients that are rounding beside the largest of their mode."""
    size = np.abs(model.coefficients / noise[:, None, None]).max(axis=(1, 2))
    kept = size > ROUNDING * size.max(axis=1, keepdims=True)
    used = kept.any(axis=0)
    return PeriodicModel(
        exponents=model.exponents,
        coefficients=(model.coefficients * kept[:, None, None, :])[..., used],
        harmonics=model.harmonics[used],
        period=model.period,
        channels=model.channels,
        provenance=model.provenance,
    )


def _check_harmonics(
    model: PeriodicModel, lifted: Lifted, residues: Complexes, scale: Floats, tolerance: float, of: str
) -> None:
    """Refuse a model that lost a part of the response with the harmonics that these phases do not tell."""
    found = model.response(lifted.phase_times).transpose(0, 2, 1).reshape(len(scale), -1)
    off = float(np.abs((found - residues.sum(axis=0).real) / scale).max())
    if off > tolerance:
        got = f"has {lifted.n_phases} a period, which leave out {off:.2g} of the largest value"
        remedy = "Sample more phases a period; of responses with noise pass a larger `tolerance`."
        raise input_error("system", of, "have phases enough for the harmonics of its modes", got, remedy)
