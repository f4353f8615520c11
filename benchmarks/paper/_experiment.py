"""The experiment of Allen 2009, section 3, done again with both algorithms, over several draws of the noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from benchmarks.paper._truth import exact_model

from floquid._arrays import Floats
from floquid._checks import input_error, integer
from floquid._show import Brief
from floquid.core import PeriodicModel, Record
from floquid.errors import IdentificationError
from floquid.lti import AMI, AbstractIdentifier
from floquid.periodic import assemble
from floquid.pipeline import Analysis, Settings, identify, validated
from floquid.reconstruction import reconstruct
from floquid.systems import JeffcottRotor
from floquid.testing import pair_exponents

MASS, TURNTABLE = ("X", "Y"), ("X_tt", "Y_tt")  # the two choices of displacement states
WINDOW = 3  # the largest |m| among which the four dominant coefficients are looked for when not among all


def dominant(model: PeriodicModel, count: int) -> PeriodicModel:
    """The model with the largest coefficients of each residue alone (Allen 2009, section 3.2)."""
    of = "dominant"
    if integer(count, "count", of, at_least=1) > len(model.harmonics):
        raise input_error("count", of, f"be at most the {len(model.harmonics)} harmonics", f"is {count}")
    if not np.array_equal(model.harmonics, -model.harmonics[::-1]):
        got = f"are {model.harmonics[0]} to {model.harmonics[-1]}"
        remedy = "Keep as many on each side."
        raise input_error("model", of, "have harmonics symmetric about zero", f"they {got}", remedy)
    size = np.abs(model.coefficients)
    # Where two are equal, conjugates must not choose differently.
    lower = model.exponents.imag < 0
    size = np.where(lower[:, None, None, None], size[..., ::-1], size)
    largest = np.argsort(-size, axis=-1, kind="stable")[..., :count]
    kept = np.zeros(size.shape, bool)
    np.put_along_axis(kept, largest, values=True, axis=-1)
    return _masked(model, np.where(lower[:, None, None, None], kept[..., ::-1], kept))


def lowest(model: PeriodicModel, most: int) -> PeriodicModel:
    """The model with the harmonics -most … most of each mode alone."""
    kept = np.abs(model.harmonics) <= integer(most, "most", "lowest", at_least=0)
    return _masked(model, np.broadcast_to(kept, model.coefficients.shape))


def _masked(model: PeriodicModel, kept: np.ndarray) -> PeriodicModel:
    std = model.coefficient_std
    return replace(
        model,
        coefficients=np.where(kept, model.coefficients, 0.0),
        coefficient_std=None if std is None else np.where(kept, std, 0.0),
    )


Cut = Callable[[PeriodicModel], PeriodicModel]

CUTS: Mapping[str, tuple[tuple[str, str], Cut]] = MappingProxyType(
    {
        "three": (MASS, lambda model: dominant(model, 3)),
        "four": (MASS, lambda model: dominant(model, 4)),
        "four_near": (MASS, lambda model: dominant(lowest(model, WINDOW), 4)),
        "two_harmonics": (MASS, lambda model: lowest(model, 2)),
        "three_harmonics": (MASS, lambda model: lowest(model, 3)),
        "turntable_three": (TURNTABLE, lambda model: dominant(model, 3)),
        "turntable_one_harmonic": (TURNTABLE, lambda model: lowest(model, 1)),
        "turntable_two_harmonics": (TURNTABLE, lambda model: lowest(model, 2)),
    }
)  # ways to cut the Fourier series short before A(t) is rebuilt, and the states


@dataclass(frozen=True, slots=True, kw_only=True)
class Draw(Brief):
    """Results of one draw of the noise, by name: largest errors of A(t), and errors of the exponents.

    Parameters
    ----------
    seed
        The seed of the noise.
    ami, maximum_likelihood
        The numbers of each algorithm.
    """

    seed: int
    ami: Mapping[str, float]
    maximum_likelihood: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reproduction(Brief):
    """The paper's experiment, done again.

    Parameters
    ----------
    rotor
        The rotor, with the paper's parameters.
    record
        The record of the first draw of the noise.
    ami, maximum_likelihood
        What the two algorithms found in it, with A(t) in the states X and Y.
    exact
        The response model by the rotor's equations.
    draws
        The errors over all draws, the first of them that of `record`.
    """

    rotor: JeffcottRotor
    record: Record
    ami: Analysis
    maximum_likelihood: Analysis
    exact: PeriodicModel
    draws: tuple[Draw, ...]


def reproduce(
    *,
    seed: int = 0,
    draws: int = 10,
    n_periods: int = 1024,
    noise: float = 0.02,
    report: Callable[[str], None] = lambda _: None,
) -> Reproduction:
    """Simulate the rotor of Allen 2009 as in its section 3, and identify it by AMI and by maximum likelihood.

    Raises InputError where a number is out of its range. Raises IdentificationError where in some draw not the four
    exponents of the rotor were found.

    Parameters
    ----------
    seed
        The seed of the first draw of the noise; each further draw has the next one.
    draws
        The number of draws of the noise.
    n_periods
        The length of the record in periods; the paper's is 1024.
    noise
        Standard deviation of the noise, as a share of the largest response of each channel; the paper's is 0.02.
    report
        Is told what is being done.
    """
    count = integer(draws, "draws", "reproduce", at_least=1)
    report("working out the truth")
    rotor = JeffcottRotor()
    exact = exact_model(rotor)
    done: list[Draw] = []
    first: tuple[Record, Analysis, Analysis] | None = None
    for number in range(count):
        stage = f"draw {number + 1} of {count}"
        report(f"{stage}: simulating")
        record = rotor.simulate(n_periods=n_periods, noise=noise, seed=seed + number)
        found = []
        for name, identifier in (("AMI", AMI()), ("maximum likelihood", None)):
            report(f"{stage}: {name}")
            found.append(_identify(record, identifier, name))
        bound = found[1].model
        done.append(
            Draw(
                seed=seed + number,
                ami=MappingProxyType(_errors(rotor, exact, found[0], bound)),
                maximum_likelihood=MappingProxyType(_errors(rotor, exact, found[1], bound)),
            )
        )
        first = first or (record, found[0], found[1])
    assert first is not None
    record, ami, ml = first
    return Reproduction(rotor=rotor, record=record, ami=ami, maximum_likelihood=ml, exact=exact, draws=tuple(done))


def _identify(record: Record, identifier: AbstractIdentifier | None, name: str) -> Analysis:
    """The analysis with A(t) in the states X and Y."""
    analysis = identify(record, Settings(identifier=identifier, validate=False))
    if analysis.model.order != 4:
        raise IdentificationError(
            f"{analysis.model.order} exponents were found by {name} where the rotor has 4: too much noise in too short "
            "a record.\n  Take more periods or less noise."
        )
    settings = replace(analysis.settings, states=MASS, validate=True)
    state = reconstruct(analysis.model, MASS, times=settings.system_times)
    return validated(replace(analysis, settings=settings, state=state))


def uncut(analysis: Analysis) -> PeriodicModel:
    """The periodic model with every harmonic below the Nyquist frequency on both sides."""
    return assemble(analysis.modal, analysis.lifted, harmonics=(analysis.lifted.n_phases - 1) // 2)


def system_error(rotor: JeffcottRotor, model: PeriodicModel, states: tuple[str, str]) -> Floats:
    """The error of A(t) in those states at fifty instants (times, 4, 4)."""
    found = reconstruct(model, states, harmonics="model")
    truth = rotor.system if states == MASS else rotor.turntable_system
    return found.system - truth(found.times)


def cut_errors(rotor: JeffcottRotor, whole: PeriodicModel) -> dict[str, float]:
    """The largest error of A(t) for each of `CUTS`, and for the first that in the damping alone."""
    found = {}
    for name, (states, cut) in CUTS.items():
        error = np.abs(system_error(rotor, cut(whole), states))
        found[name] = float(error.max())
        if name == "three":
            found["three_damping"] = float(error[:, 2:, 2:].max())
    return found


def _errors(rotor: JeffcottRotor, exact: PeriodicModel, analysis: Analysis, bound: PeriodicModel) -> dict[str, float]:
    """The largest errors of A(t), and the exponents' errors over the deviations of `bound`."""
    found = cut_errors(rotor, uncut(analysis))
    found["own"] = float(np.abs(system_error(rotor, analysis.model, MASS)).max())
    for number, (estimate, truth, std) in enumerate(paired(analysis.model, exact, bound), start=1):
        found[f"real_{number}"] = abs(estimate.real - truth.real) / std.real
        found[f"imag_{number}"] = abs(estimate.imag - truth.imag) / std.imag
    return found


def paired(model: PeriodicModel, exact: PeriodicModel, bound: PeriodicModel) -> list[tuple[complex, complex, complex]]:
    """Estimate, truth and deviation of each upper principal exponent, in the paper's order: ascending Im λ."""
    principal = exact.principal()
    upper = np.flatnonzero(principal.imag > 0)
    upper = upper[np.argsort(principal.imag[upper])]
    pairs = pair_exponents(model.principal(), principal, model.period)
    others = pair_exponents(bound.principal(), principal, model.period)
    std = bound.exponent_std
    assert std is not None
    return [
        (complex(principal[r] + pairs.differences[r]), complex(principal[r]), complex(std[others.permutation[r]]))
        for r in upper
    ]
