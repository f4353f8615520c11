"""Results of any kind and known systems in all their forms as points of a survey, their modes as objects to follow."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats
from floquid._checks import input_error, wrong_value
from floquid.core import Channel, PeriodicModel, Record, Shape
from floquid.floquet import (
    AbstractPeriodicMatrix,
    FloquetModes,
    FunctionMatrix,
    HarmonicMatrix,
    MatrixFile,
    OpenFastLinearisation,
    exponents,
)
from floquid.floquet import (
    modes as modes_of,
)
from floquid.periodic import CONFIDENT
from floquid.shapes import APART, ShapeOptions, sidebands_of
from floquid.surveys._objects import SHIFTS, Seen, moved
from floquid.surveys._types import Point

_MODULE = re.compile(r"^(?:ED|BD\d*|AD\d*|ADsk|SrvD|IfW|HD|SD|SED|SeaSt|MAP|MD|FEAM|ExtPtfm|Orca)\s+")
"""The module of OpenFAST before the name of an output."""


@runtime_checkable
class ObservedSystem(Protocol):
    """Interface of a system with outputs, such as `systems.JeffcottRotor`: x' = A(t) x, y = C(t) x."""

    @property
    def period(self) -> float:
        """The period [s]."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """One `Channel` an output."""

    def system(self, t: ArrayLike) -> Floats:
        """The state matrix at the times `t` (..., n, n)."""
        ...

    def outputs(self, t: ArrayLike) -> Floats:
        """The output matrix at the times `t` (..., outputs, n)."""
        ...


KNOWN = (AbstractPeriodicMatrix, MatrixFile, OpenFastLinearisation, ObservedSystem)
"""Types of known systems."""


def known_modes(
    system: Any,
    *,
    outputs: AbstractPeriodicMatrix | ArrayLike | None = None,
    channels: Sequence[Channel | str] | None = None,
) -> FloquetModes | PeriodicModel:
    """The modes of a known system, in its channels where it has outputs.

    `system` is a matrix A(t) with its period, (A, period), a system with outputs, a file or a linearisation as
    `floquet.read_matrix` and `floquet.read_openfast` give it, or its modes. `outputs` is C in place of the system's
    own, and `channels` are its rows. InputError where it is something else.
    """
    if isinstance(system, (FloquetModes, PeriodicModel)):
        return system
    matrix, period, observed = _described(system)
    own, names, point = (None, None, {}) if observed is None else observed()
    if outputs is not None:
        own, names = outputs, channels
    if own is None:
        return modes_of(matrix, period)
    return modes_of(matrix, period, outputs=own, channels=names, point=point)


def known_exponents(system: Any) -> Complexes:
    """The exponents of a known `system`, as `known_modes` takes it, on any branch (modes,) [1/s]."""
    if isinstance(system, (FloquetModes, PeriodicModel)):
        return system.exponents
    return exponents(*_described(system)[:2])


def _described(system: Any) -> tuple[Any, float | None, Callable[[], tuple[Any, Any, dict[str, float]]] | None]:
    """A(t), its period where it does not state it, and what makes C, its channels and the operating point."""
    match system:
        case OpenFastLinearisation():
            harmonics, coefficients = system.harmonics()
            matrix = HarmonicMatrix(coefficients=coefficients, harmonics=harmonics, period=system.period)
            return matrix, None, lambda: (*_turbine_outputs(system), turbine_point(system))
        case MatrixFile(linearisation=None):
            own = system.outputs, system.output_names
            named: Any = (np.eye(len(system.states)), system.states) if system.outputs is None else own
            return system.matrix, None, lambda: (*named, {})
        case MatrixFile():
            turbine: Any = system.linearisation
            return system.matrix, None, lambda: (*_turbine_outputs(turbine), turbine_point(turbine))
        case AbstractPeriodicMatrix():
            return system, None, None
        case ObservedSystem():
            matrix, outputs = (
                partial(FunctionMatrix, function=function, period=system.period, vectorised=True)
                for function in (system.system, system.outputs)
            )
            return matrix(), None, lambda: (outputs(), system.channels, {})
        case (inner, period):
            return inner, period, None
    remedy = "Pass A(t) with its period, as `(A, period)`, or `floquet.modes(A, period, outputs=C)`."
    raise wrong_value("system", "floquid", "be a known system", system, remedy)


def is_linearised(folder: Path) -> bool:
    """True of a `folder` with linearisations of OpenFAST, `.lin` files: of one operating point each."""
    return folder.is_dir() and any(file.suffix.lower() == ".lin" for file in folder.iterdir())


def turbine_point(turbine: OpenFastLinearisation) -> dict[str, float]:
    """The operating point of a `turbine`: `speed_rpm`, and `wind_m_s` where its files state the wind."""
    wind = {} if turbine.wind_speed is None else {"wind_m_s": turbine.wind_speed}
    return {"speed_rpm": turbine.rotor_speed * 30.0 / np.pi, **wind}


def _turbine_outputs(turbine: OpenFastLinearisation) -> tuple[HarmonicMatrix | Floats, Sequence[Channel]]:
    """C and the channels of a turbine, named as OpenFAST names them in time series; of files without C the states."""
    signals = turbine.states if turbine.C is None else turbine.outputs
    names = [_MODULE.sub("", name).strip(" ,") for name in signals.names]
    kept = [k for k, name in enumerate(names) if name and names.index(name) == k]
    units = signals.units or ("-",) * len(names)
    channels = [Channel(name=names[k], quantity="other", unit=units[k] or "-") for k in kept]
    if turbine.C is None:
        return np.eye(len(names))[kept], channels
    harmonics, coefficients = turbine.harmonics("C")
    return HarmonicMatrix(coefficients=coefficients[kept], harmonics=harmonics, period=turbine.period), channels


OF = "survey"
EQUAL = 1e-9  # share of the range within which two points are one


NOT_READ = ShapeOptions()


def point_of(result: Any, shapes: ShapeOptions = NOT_READ, *, sidebands: bool = False) -> Point:
    """A `result` as a point of a survey, with its `shapes` read as they say; a point stays one.

    With `sidebands` these are read too.
    """
    if isinstance(result, Point):
        again = bool(shapes) and result.model is not None and result.whirl is None and result.blades is None
        return replace(result, **_read(result.model, shapes)) if again else result
    if isinstance(result, KNOWN):
        result = known_modes(result)
    modes, judged = getattr(result, "model", result), hasattr(result, "passed")
    if not isinstance(modes, (PeriodicModel, FloquetModes)):
        must, got = "hold results of `identify`, files of such, or modes of known systems", f"holds {result!r:.60}"
        raise input_error("results", OF, must, got, "Pass what `identify` or `load` gives.")
    lines: list[Shape] = []
    known = isinstance(modes, FloquetModes)
    if known:
        model = _of_states(modes)
    else:
        lines = [modes.shape(mode) for mode in range(modes.order)]
        model = _one_hit(modes, lines)
    weak = np.zeros(model.order, bool)
    # By its verdict, as of the result alone: of one that was not checked there is none.
    fails = judged and bool(result.reasons) and (result.failed or not (result.passed or result.passed is None))
    if judged:
        std = model.exponent_std
        weak[:] = True if std is None else np.maximum(std.real, std.imag) > CONFIDENT * model.fundamental
    return Point(
        values=model.point,
        files=model.provenance.sources if judged else (),
        model=model,
        passed=not judged or bool(result.passed),
        weak=weak,
        reason=result.reasons[0] if fails else None,
        **(_read(model if known else result, shapes) if shapes else {}),
        agreement=None if known else np.array([shape.agreement for shape in lines]),
        sidebands=sidebands_of(modes) if sidebands and not known else None,
        marks=_marks(getattr(result, "records", ())),
    )


def _marks(records: Sequence[Record]) -> tuple[str, ...]:
    """Marks of the samples of each channel of the records of an analysis; none of what has no records."""
    rows = [row for record in records for row in record.values if np.fmax.reduce(row) > np.fmin.reduce(row)]
    return tuple(sha256(np.ascontiguousarray(row).tobytes()).hexdigest() for row in rows)


def _read(result: Any, shapes: ShapeOptions) -> dict[str, Any]:
    """Whirl and patterns over blades of each mode, as fields of a point; conjugates are not read."""
    readings, count = shapes.read(result).modes, getattr(result, "model", result).order
    whirl, blades, names = np.full((count, 2), np.nan), np.full((count, 4), np.nan), [""] * count
    whirl_interval, leak_interval = np.full((2, count, 2), np.nan)
    for reading in readings:
        if reading.whirl is not None:
            own = reading.whirl
            whirl[reading.mode] = own.index, np.nan if own.std is None else own.std
            whirl_interval[reading.mode] = own.interval or (np.nan, np.nan)
        if reading.blades is not None:
            own = reading.blades
            leak_std = np.nan if own.leak_std is None else own.leak_std
            blades[reading.mode] = own.shares[0].share, own.leak, leak_std, own.line
            leak_interval[reading.mode] = own.leak_interval or (np.nan, np.nan)
            names[reading.mode] = own.words if reading.name is not None else ""
    return {
        "whirl": whirl if shapes.pairs else None,
        "whirl_interval": whirl_interval if shapes.pairs else None,
        "blades": blades if shapes.blades or shapes.fixed else None,
        "leak_interval": leak_interval if shapes.blades or shapes.fixed else None,
        "names": tuple(names),
    }


def check_points(points: Sequence[Point], over: str) -> tuple[Point, ...]:
    """The points, ascending; refused where their values are missing or equal, or periods or units do not fit."""

    def names(of: Sequence[Point]) -> str:
        return _names(points, of)

    missing = [point for point in points if over not in point.values]
    if missing:
        remedy = f'Give it to the record, `Record(point={{"{over}": 742.0}})`, or by `--point {over}=742`.'
        raise input_error("results", OF, f"have a value of {over} each", f"{names(missing)} has none", remedy)
    ordered = tuple(sorted(points, key=lambda point: point.values[over]))
    values = np.array([point.values[over] for point in ordered])
    for first in np.flatnonzero(np.diff(values) <= EQUAL * max(np.ptp(values), 1e-300)) if len(values) > 1 else ():
        got = f"{names(ordered[first : first + 2])} are both at {values[first]:g}"
        remedy = "Identify them together: records of one point are hits."
        raise input_error("results", OF, f"be at different values of {over}", got, remedy)
    check_alike(ordered)
    return ordered


def _names(points: Sequence[Point], of: Sequence[Point]) -> str:
    """The files of some points, or their numbers among all."""
    return "; ".join(", ".join(point.files) or f"result {points.index(point) + 1}" for point in of)


def check_alike(points: Sequence[Point], of: str = OF) -> None:
    """Refuse periods that are not the same part of a revolution, as exponents are known modulo iω, and unlike units."""
    units: dict[str, tuple[str, Point]] = {}
    for point in points:
        channels = () if point.model is None else point.model.channels
        for channel in [channel for channel in channels if channel.unit != "-"]:
            unit, first = units.setdefault(channel.name, (channel.unit, point))
            if unit != channel.unit:
                both = f"{_names(points, [point])} has {channel.name!r} in {channel.unit}"
                got = f"{both}, and {_names(points, [first])} in {unit}"
                remedy = "Bring the records to one unit first: shapes are compared channel by channel."
                raise input_error("results", of, "have one unit a channel", got, remedy)
    known = [point for point in points if point.model is not None and point.values.get("speed_rpm", 0.0) > 0.0]
    turns = np.array([point.model.period * point.values["speed_rpm"] / 60.0 for point in known if point.model])
    if not len(turns):
        return
    usual = float(np.quantile(turns, 0.5, method="lower"))
    off = np.flatnonzero(np.abs(turns / usual - 1.0) > APART)
    if len(off):
        one = _names(points, [known[off[0]]])
        most = "the other" if len(turns) == 2 else "most"
        got = f"{one} has one of {turns[off[0]]:.4g} revolutions, and {most} {usual:.4g}"
        remedy = "Identify all records with the period of the same part of a revolution: exponents are known modulo iω."
        raise input_error("results", of, "have periods of one part of a revolution", got, remedy)


def _of_states(modes: FloquetModes) -> PeriodicModel:
    """Modes of a known A(t) as a model whose channels are the states."""
    return PeriodicModel(
        exponents=modes.exponents,
        coefficients=modes.coefficients[:, :, None],
        harmonics=modes.harmonics,
        period=modes.period,
        channels=[f"x{k + 1}" for k in range(modes.coefficients.shape[1])],
    )


def _one_hit(modes: PeriodicModel, shapes: Sequence[Shape]) -> PeriodicModel:
    """A model with one shape a mode, as one of a single hit."""
    std = [shape.std for shape in shapes if shape.std is not None]
    if modes.n_hits == 1 and len(std) < modes.order and modes.coefficient_std is not None:
        std = list(modes.coefficient_std[:, :, 0])  # a model that has lost its joint covariance
    return PeriodicModel(
        exponents=modes.exponents,
        coefficients=np.reshape([shape.values for shape in shapes], (-1, len(modes.channels), 1, len(modes.harmonics))),
        harmonics=modes.harmonics,
        period=modes.period,
        channels=modes.channels,
        covariance=modes.covariance,
        coefficient_std=np.array(std)[:, :, None] if len(std) == modes.order and std else None,
        provenance=modes.provenance,
        point=modes.point,
    )


def objects_of(points: Sequence[Point], of: str = OF) -> list[list[Seen]]:
    """The objects of each point, shapes in the channels that all points have, over the noise of each."""
    models = [point.model for point in points if point.model is not None]
    names = [[channel.name for channel in model.channels] for model in models]
    common = [name for name in names[0] if all(name in own for own in names)] if names else []
    if names and len(common) < min(2, max(map(len, names))):
        got = f"share {common[0] if common else 'none'}"
        remedy = "Record the same channels at every point, or name them alike: `--channels`, `--names`."
        raise input_error("results", of, "have two channels in common at least", got, remedy)
    reach = max((int(np.abs(model.harmonics).max()) for model in models), default=0) + SHIFTS
    weights = _weights(models, common)
    return [[] if point.model is None else _objects(point, common, weights, reach) for point in points]


def _weights(models: Sequence[PeriodicModel], common: Sequence[str]) -> Floats:
    """One over the noise of each channel, pooled over points and modes; over its size where none was estimated."""
    noisy = [model for model in models if model.coefficient_std is not None]
    squares = np.zeros(len(common))
    for model in noisy or models:
        values = model.coefficient_std if noisy and model.coefficient_std is not None else model.coefficients
        rows = [[channel.name for channel in model.channels].index(name) for name in common]
        squares += np.mean(np.abs(values[:, rows]) ** 2, axis=(0, 2, 3))
    return 1.0 / np.sqrt(np.maximum(squares, 1e-300))


def _objects(point: Point, common: Sequence[str], weights: Floats, reach: int) -> list[Seen]:
    """The objects of one point."""
    model, weak = point.model, point.weak
    assert model is not None
    rows = [[channel.name for channel in model.channels].index(name) for name in common]

    def widened(values: Complexes) -> Complexes:
        out = np.zeros((model.order, len(rows), 2 * reach + 1), complex)
        out[:, :, model.harmonics + reach] = values[:, rows, 0] * weights[:, None]
        return out

    shapes = widened(model.coefficients)
    deviations = np.zeros_like(shapes) if model.coefficient_std is None else widened(model.coefficient_std)
    count = model.order
    covariance = np.zeros((2 * count, 2 * count)) if model.covariance is None else model.covariance
    couples = _couples(model)
    inside = {mode for couple in couples for mode in couple}
    groups = [*couples, *((mode,) for mode in model.upper_modes if mode not in inside)]
    found = []
    for modes in groups:
        kept = np.array(modes)
        parts = np.concatenate([kept, kept + count])
        lam = model.exponents[kept]
        turns = np.rint((lam[0].imag - lam.imag) / model.fundamental).astype(int)  # both of a couple on one branch
        grows = int(kept[lam.real.argmax()])  # what decays faster in a lock may be below the noise
        found.append(
            Seen(
                modes=modes,
                exponents=lam + 1j * model.fundamental * turns,
                covariance=covariance[np.ix_(parts, parts)],
                shapes=np.array([moved(shapes[k], turn) for k, turn in zip(modes, turns, strict=True)]),
                deviations=np.array([moved(deviations[k], turn) for k, turn in zip(modes, turns, strict=True)]),
                fundamental=model.fundamental,
                weak=weak is not None and bool(weak[grows]),
                agreement=1.0 if point.agreement is None else float(point.agreement[grows]),
            )
        )
    return found


def _couples(model: PeriodicModel) -> list[tuple[int, int]]:
    """The couples of a model, and two negative multipliers that are left over: of a real system none is alone."""
    couples = list(model.couples)
    inside = {mode for couple in couples for mode in couple}
    turns = np.rint(2.0 * model.exponents.imag / model.fundamental).astype(int)
    left = [int(mode) for mode in np.flatnonzero(model.real & (turns % 2 == 1)) if mode not in inside]
    return [*couples, (left[0], left[1])] if len(left) == 2 else couples
