"""Known systems in all their forms as modes in channels: A(t) with its period and outputs, files, linearisations."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Complexes, Floats
from floquid._checks import describe, input_error
from floquid.core import Channel, PeriodicModel
from floquid.floquet import (
    AbstractPeriodicMatrix,
    FloquetModes,
    FunctionMatrix,
    HarmonicMatrix,
    MatrixFile,
    OpenFastLinearisation,
    exponents,
    modes,
)

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
    `floquet.read_matrix` and `floquet.read_openfast` give it, or its modes. `outputs` is C of a system without, and
    `channels` are its rows. InputError where it is something else.
    """
    if isinstance(system, (FloquetModes, PeriodicModel)):
        return system
    matrix, period = _matrix(system)
    point: dict[str, float] = {}
    names = channels
    match system:
        case OpenFastLinearisation() | MatrixFile(linearisation=OpenFastLinearisation()):
            turbine = system if isinstance(system, OpenFastLinearisation) else system.linearisation
            assert turbine is not None
            outputs, names = _turbine_outputs(turbine)
            point = turbine_point(turbine)
        case MatrixFile():
            outputs, names = system.outputs, system.output_names
            if outputs is None:
                outputs, names = np.eye(len(system.states)), system.states
        case ObservedSystem() if outputs is None:
            outputs = FunctionMatrix(function=system.outputs, period=system.period, vectorised=True)
            names = system.channels
    if outputs is None:
        return modes(matrix, period)
    return modes(matrix, period, outputs=outputs, channels=names, point=point)


def known_exponents(system: Any) -> Complexes:
    """The exponents of a known `system`, as `known_modes` takes it, on any branch (modes,) [1/s]."""
    if isinstance(system, (FloquetModes, PeriodicModel)):
        return system.exponents
    return exponents(*_matrix(system))


def _matrix(system: Any) -> tuple[Any, float | None]:
    """A(t) of a system, and the period where it does not state it."""
    match system:
        case OpenFastLinearisation():
            harmonics, coefficients = system.harmonics()
            return HarmonicMatrix(coefficients=coefficients, harmonics=harmonics, period=system.period), None
        case MatrixFile():
            return system.matrix, None
        case AbstractPeriodicMatrix():
            return system, None
        case ObservedSystem():
            return FunctionMatrix(function=system.system, period=system.period, vectorised=True), None
        case (inner, period):
            return inner, period
    remedy = "Pass A(t) with its period, as `(A, period)`, or `floquet.modes(A, period, outputs=C)`."
    raise input_error("system", "floquid", "be a known system", f"is {describe(system)}", remedy)


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
