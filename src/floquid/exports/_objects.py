"""Models and records to and from the objects of other packages: floquid.floquet and python-control, xarray."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from floquid._arrays import Complexes, Floats, Integers, Mask
from floquid._checks import an_instance, input_error, integer, wrong_value
from floquid.core import Channel, ModelInputs, PeriodicModel, Provenance, Record
from floquid.errors import IdentificationError
from floquid.floquet import DiscretePeriodicSystem, PeriodicSystem, SampledMatrix, discretise
from floquid.inputs import input_gain
from floquid.io import load_package
from floquid.readers import record_to_xarray
from floquid.reconstruction import reconstruct

if TYPE_CHECKING:
    import xarray as xr

ROUNDING = 1e-12  # the share of the largest coefficient of a mode below which one is rounding
LOST = 1e-8  # the share of the largest coefficient that may stand at the last harmonics that the phases tell
DEFECTIVE = 1e10  # the condition of the shapes from which on they are no basis


def to_periodic_system(
    model: PeriodicModel, states: Sequence[str] | None = None, *, n_phases: int = 128
) -> PeriodicSystem:
    r"""A(t), B(t), C(t) and D(t) of a model, for simulation and python-control.

    Without `states` in real Floquet coordinates, where a pair :math:`\lambda = \sigma \pm i \nu` is

    .. math:: A = \begin{bmatrix} \sigma & -\nu \\ \nu & \sigma \end{bmatrix}, \qquad
              B(t) = \begin{bmatrix} \Re b(t) \\ \Im b(t) \end{bmatrix}, \qquad
              C(t) = 2\,[\Re c(t), -\Im c(t)]

    and a positive real multiplier has one state. Two negative ones turn together by half a turn a period, which makes
    them real and periodic (Montagnier, Paige and Spiteri 2003): the rest of A is constant. All is exact, and discrete
    systems come by `floquet.discretise`, lifted ones by `floquet.lift`, those of python-control by its `to_control`.
    Of free responses there is no B and D, and C is that of the hit in which a mode is strongest.

    `states` are the channels of the `model` taken as displacements, as `reconstruct` takes them: A(t) is then in them
    and their velocities, at `n_phases` samples a period. Raises InputError where the model has no modes, an odd number
    of negative real multipliers, whose A(t) is not real, or the states are none; IdentificationError where the channels
    do not tell the states.
    """
    of = "exports.to_periodic_system"
    an_instance(model, PeriodicModel, "model", of, "Of an analysis pass its `model`.")
    if not model.order:
        raise input_error("model", of, "have modes", "has none")
    if states is None:
        names, stacks = _floquet_coordinates(model, of)
    else:
        state = reconstruct(model, states, harmonics="model", times=integer(n_phases, "n_phases", of, at_least=1))
        names, stacks = state.states, (state.system, state.inputs, state.outputs, state.direct)
    A, B, C, D = (
        None if stack is None or not stack.size else SampledMatrix(values=np.moveaxis(stack, 0, 2), period=model.period)
        for stack in stacks
    )
    assert A is not None
    own = model.inputs
    return PeriodicSystem(
        A=A,
        B=B,
        C=C,
        D=D,
        states=names,
        inputs=None if own is None else [channel.name for channel in own.channels],
        outputs=None if C is None else [channel.name for channel in model.channels],
    )


def _floquet_coordinates(model: PeriodicModel, of: str) -> tuple[list[str], tuple[Floats | None, ...]]:
    """Names of the real states, and A, B, C and D at equal phases (phases, rows, columns)."""
    own, omega = model.inputs, model.fundamental
    ends = [model.harmonics, *(() if own is None else (own.harmonics, own.direct_harmonics))]
    count = 2 * max(int(np.abs(end).max(initial=0)) for end in ends) + 5
    times = model.period * np.arange(count) / count
    strongest = np.abs(model.coefficients).sum(axis=(1, 3)).argmax(axis=1)
    shapes = model.shapes(times)[np.arange(model.order), :, strongest]
    seen = np.asarray(np.moveaxis(shapes, 2, 0), np.complex128)  # (phases, modes, channels)
    gains: Complexes = np.zeros((count, model.order, 0), np.complex128)
    if own is not None:
        turned = np.exp(1j * omega * np.multiply.outer(times, own.harmonics))
        gains = np.asarray(np.einsum("ril,tl->tri", own.coefficients, turned), np.complex128)
    negative = np.flatnonzero(model.real & (model.multipliers.real < 0.0))
    if len(negative) % 2:
        must, got = "have its negative real multipliers in twos", f"has {len(negative)}"
        raise input_error("model", of, must, got, "One alone has no real A(t) of this period: pass `states`.")
    number = {mode: place for place, mode in enumerate(model.upper_modes, start=1)}
    names, rates, rows, columns = [], [], [], []
    for mode in [r for r in model.upper_modes if r not in negative]:
        exponent = complex(model.exponents[mode])
        sigma, nu = exponent.real, exponent.imag
        c, b = seen[:, mode], gains[:, mode]
        if model.real[mode]:
            turn = np.exp(1j * nu * times)[:, None]  # a whole number of turns a period, or none
            rates.append(np.full((count, 1, 1), sigma))
            rows.append((b / turn).real[:, None])
            columns.append((c * turn).real[:, :, None])
        else:
            rates.append(np.broadcast_to([[sigma, -nu], [nu, sigma]], (count, 2, 2)))
            rows.append(np.stack([np.real(b), np.imag(b)], axis=1))
            columns.append(np.stack([2.0 * c.real, -2.0 * c.imag], axis=2))
        word = f"mode {number[mode]}"
        names += [word] if model.real[mode] else [f"Re {word}", f"Im {word}"]
    for one, other in negative.reshape(-1, 2).tolist():
        both, half = [one, other], 0.5 * omega
        turn = np.exp(1j * np.multiply.outer(times, model.exponents[both].imag))
        cos, sin = np.cos(half * times), np.sin(half * times)
        R = np.moveaxis(np.array([[cos, -sin], [sin, cos]]), 2, 0)
        rates.append(
            (R * model.exponents[both].real) @ R.transpose(0, 2, 1) + half * np.array([[0.0, -1.0], [1.0, 0.0]])
        )
        rows.append(R @ (gains[:, both] / turn[:, :, None]).real)
        columns.append((seen[:, both] * turn[:, :, None]).real.transpose(0, 2, 1) @ R.transpose(0, 2, 1))
        names += [f"modes {number[one]} and {number[other]}, {word}" for word in ("first", "second")]
    A, place = np.zeros((count, len(names), len(names))), 0
    for rate in rates:
        block = slice(place, place + rate.shape[1])
        A[:, block, block], place = rate, block.stop
    direct = None
    if own is not None:
        straight = np.exp(1j * omega * np.multiply.outer(times, own.direct_harmonics))
        direct = np.einsum("cil,tl->tci", own.direct, straight).real
    return names, (A, np.concatenate(rows, axis=1), np.concatenate(columns, axis=2), direct)


def from_periodic_system(
    system: PeriodicSystem | DiscretePeriodicSystem,
    *,
    n_phases: int = 64,
    channels: Sequence[Channel | str] | None = None,
    inputs: Sequence[Channel | str] | None = None,
) -> PeriodicModel:
    r"""The model with inputs of a system: exponents, c and b by its Floquet modes.

    .. math:: x_k = \sum_r p_{r,k}\, z_{r,k}, \qquad c_r(t_k) = C_k\, p_{r,k}, \qquad
              \beta_r(t_k) = (P_{k+1}^{-1} B_k)_r, \qquad
              b_{r,l} = \beta_{r,l} \Big/ \int_0^h e^{\lambda_r (h - \tau) + i l \omega \tau}\, d\tau

    which takes the input of a discrete system for one that is held. A system of python-control that was lifted comes by
    `floquet.realise`. Each exponent is on the branch where its outputs are strongest in the zeroth harmonic, every
    output over its largest; the largest b of a mode is 1. There are no deviations.

    A `system` of continuous time is taken at `n_phases` a period, as `floquet.discretise` takes it. `channels` and
    `inputs` are its outputs and inputs; by default of their names. Raises InputError where the system is none, cannot
    be integrated, or channels are not as many as its signals; IdentificationError where a multiplier is zero or
    repeated with fewer shapes, or the phases do not tell all harmonics.
    """
    of = "exports.from_periodic_system"
    if isinstance(system, PeriodicSystem):
        system = discretise(system, integer(n_phases, "n_phases", of, at_least=4))
    if not isinstance(system, DiscretePeriodicSystem):
        must = "be a PeriodicSystem or a DiscretePeriodicSystem"
        raise wrong_value("system", of, must, system, "One of python-control by `floquet.realise`.")
    outputs = _named(channels, system.outputs, "channels", of)
    sources = _named(inputs, system.inputs, "inputs", of)
    exponents = system.exponents()
    shapes = system.modes()[1] if np.isfinite(exponents).all() else np.zeros(system.A.shape, complex)
    if not np.linalg.cond(shapes).max() < DEFECTIVE:
        raise IdentificationError(
            "The system has a multiplier of zero, or repeated ones with fewer shapes than states: no model of separate "
            "modes has its response. Reduce it first."
        )
    omega = 2.0 * np.pi / system.period
    exponents, shapes, real, pairs = _on_branches(system, exponents, shapes)
    forcing = np.asarray(np.linalg.solve(np.roll(shapes, -1, axis=0), system.B.astype(complex)), np.complex128)
    harmonics, seen = _harmonics(system.C @ shapes)
    reach, gains = _harmonics(forcing.transpose(0, 2, 1))
    for mode, exponent in enumerate(exponents.tolist()):
        shares = [input_gain(exponent, turn, omega, system.dt, "zero")[0] for turn in reach.tolist()]
        gains[:, :, mode] /= np.array(shares)[:, None]
    if sources:
        scale = _scale(gains, real, pairs)
        gains, seen = gains / scale, seen * scale
    straight, direct = _harmonics(system.D.astype(complex))
    (harmonics, seen), (reach, gains), (straight, direct) = (
        _told(*part, of) for part in ((harmonics, seen), (reach, gains), (straight, direct))
    )
    own = None
    if sources:
        own = ModelInputs(
            channels=sources,
            coefficients=np.moveaxis(gains, (0, 2), (2, 0)),
            harmonics=reach,
            direct=np.moveaxis(direct, 0, 2),
            direct_harmonics=straight,
            initial=np.zeros((len(exponents), 0), complex),
        )
    return PeriodicModel(
        exponents=exponents,
        coefficients=np.moveaxis(seen, (0, 2), (2, 0))[:, :, None],
        harmonics=harmonics,
        period=system.period,
        channels=outputs,
        provenance=Provenance(sources=(f"a {type(system).__name__}",)),
        inputs=own,
    )


def _on_branches(
    system: DiscretePeriodicSystem, exponents: Complexes, shapes: Complexes
) -> tuple[Complexes, Complexes, Mask, list[tuple[int, int]]]:
    """Exponents and shapes where the outputs are strongest in the zeroth harmonic; which are real, and the pairs."""
    omega, phases = 2.0 * np.pi / system.period, system.n_phases
    halves = 2.0 * exponents.imag / omega
    real = np.isclose(halves, np.rint(halves), atol=1e-9)
    seen = system.C @ shapes
    scale = np.abs(seen).max(axis=(0, 2), initial=0.0)
    lines = np.fft.fft(seen, axis=0) / np.where(scale > 0.0, scale, 1.0)[:, None]
    turns = np.fft.fftfreq(phases, 1.0 / phases)[(np.abs(lines) ** 2).sum(axis=1).argmax(axis=0)]
    turns[real] = 0.0
    above = np.flatnonzero((exponents.imag > 0.0) & ~real)
    pairs = [(int(r), int(np.argmin(np.abs(exponents - exponents[r].conj())))) for r in above]
    exponents = exponents + 1j * omega * turns
    shapes = shapes * np.exp(-2j * np.pi * np.multiply.outer(np.arange(phases) / phases, turns))[:, None, :]
    for one, other in pairs:
        exponents[other], shapes[:, :, other] = exponents[one].conj(), shapes[:, :, one].conj()
    return exponents, shapes, real, pairs


def _scale(gains: Complexes, real: Mask, pairs: list[tuple[int, int]]) -> Complexes:
    """The largest b of each mode (modes,), its size where the multiplier is real; 1 where no input reaches it."""
    flat = gains.reshape(-1, gains.shape[2])
    largest = flat[np.abs(flat).argmax(axis=0), np.arange(len(real))]
    largest = np.where(largest == 0.0, 1.0, np.where(real, np.abs(largest), largest))
    for one, other in pairs:
        largest[other] = largest[one].conj()
    return largest


def _named(given: Sequence[Channel | str] | None, names: Sequence[str], argument: str, of: str) -> tuple[Channel, ...]:
    """Channels of signals."""
    chosen = tuple(c if isinstance(c, Channel) else Channel(name=str(c)) for c in (names if given is None else given))
    if len(chosen) != len(names):
        raise input_error(argument, of, f"be one of each of {len(names)} signals", f"are {len(chosen)}")
    return chosen


def _harmonics(values: Complexes) -> tuple[Integers, Complexes]:
    """Harmonics, ascending, of values at equal phases, the first axis."""
    turns = np.rint(np.fft.fftfreq(len(values), 1.0 / len(values))).astype(np.int64)
    order = np.argsort(turns)
    return turns[order], np.fft.fft(values, axis=0)[order] / len(values)


def _told(harmonics: Integers, values: Complexes, of: str) -> tuple[Integers, Complexes]:
    """Harmonics without those that are rounding; refused where the outermost are not."""
    size = np.abs(values).max(axis=(1,), initial=0.0)
    share = (size / np.maximum(size.max(axis=0, initial=0.0), np.finfo(float).tiny)).max(axis=1, initial=0.0)
    ends = max(share[0], share[-1])
    if len(share) > 1 and ends > LOST:
        raise IdentificationError(
            f"`{of}`: {len(share)} phases a period do not tell all harmonics of the system: {ends:.1g} of the largest "
            "is left at the last of them. Take more: `n_phases`."
        )
    kept = share > ROUNDING
    return harmonics[kept], values[kept]


_OF_MODES = {
    "exponents": "1/s",
    "exponent_std": "1/s",
    "multipliers": "1",
    "multiplier_std": "1",
    "frequencies_hz": "Hz",
    "frequency_std_hz": "Hz",
    "damping_ratios": "1",
    "damping_ratio_std": "1",
}
_AXES = ("mode", "channel", "hit", "harmonic")


def to_xarray(thing: Record | PeriodicModel) -> xr.Dataset:
    """A record or a periodic model as labelled arrays, whose values are copies.

    Of a record: `response` (channel, time), and `orbit` (channel, phase) where there is one. `time` is in seconds. The
    attributes of `response` are `sample_rate` [Hz] and, of a constant period, `period` and `origin` [s].

    Of a model: `exponents`, `multipliers`, `frequencies_hz` and `damping_ratios` (mode), `coefficients` (mode, channel,
    hit, harmonic), and where they were estimated `exponent_std`, `multiplier_std`, `frequency_std_hz`,
    `damping_ratio_std` (mode) and `coefficient_std`: of complex numbers, the deviation of the real part as the real
    part and that of the imaginary part as the imaginary part. Modes and hits count from 1, units are in the attributes,
    the period [s] is an attribute. The joint covariance is not in it: it is kept by `floquid.save`.

    Along `channel` there are the names, and `unit`, `quantity`, `location`, `direction` and `place`.

    Complex numbers stay complex. The `thing` is the record or the model. Raises InputError where xarray is not
    installed, or it is another thing.
    """
    if isinstance(thing, Record):
        return record_to_xarray(thing)
    if not isinstance(thing, PeriodicModel):
        raise wrong_value("thing", "to_xarray", "be a Record or a PeriodicModel", thing)
    model, xarray = thing, load_package("xarray", "to_xarray")
    variables: dict[str, Any] = {}
    for name, unit in _OF_MODES.items():
        values = getattr(model, name)
        if values is not None:
            variables[name] = ("mode", np.array(values), {"units": unit})
    for name in ("coefficients", "coefficient_std"):
        values = getattr(model, name)
        if values is not None:
            variables[name] = (_AXES, np.array(values), {"units": "that of the channel"})
    coordinates: dict[str, Any] = {
        "mode": np.arange(1, model.order + 1),
        "channel": [channel.name for channel in model.channels],
        "hit": np.arange(1, model.n_hits + 1),
        "harmonic": np.array(model.harmonics),
    }
    for word in ("unit", "quantity", "location", "direction", "place"):
        coordinates[word] = ("channel", [str(getattr(channel, word)) for channel in model.channels])
    return xarray.Dataset(variables, coords=coordinates, attrs={"period": model.period, "period_units": "s"})
