"""Cases that are read: a lab rotor of a physics engine and a forced Duffing chain, from the data of the tests."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from benchmarks.chain.case import Case, noisy
from numpy.typing import NDArray

from floquid import Record, read

DATA = Path(__file__).resolve().parents[2] / "tests" / "data"

MUST = {
    "rotor_1900rpm": (0.2581, 0.2861, 0.2886, 0.3690, 0.3717, 0.4011, 0.4326, 0.4913),
    "rotor_650rpm": (0.0564, 0.0715, 0.2603, 0.3075, 0.0021),
}
"""|Im λ|/ω of the modes that must be found in 1 % of noise, as the data's README says."""

HELD = 0.005
"""The noise that the record with a tachometer holds already, a share of each channel's largest free response."""


def truth_of(name: str) -> tuple[float, NDArray[np.complex128]]:
    """The period and every true exponent."""
    truth = json.loads((DATA / f"{name}.truth.json").read_text(encoding="utf-8"))
    return truth["period"], np.array([complex(*mode["exponent"]) for mode in truth["modes"]])


def must_of(name: str) -> tuple[float, NDArray[np.complex128], NDArray[np.bool_]]:
    """The period of the lab rotor, its exponents, and which must be found."""
    period, exponents = truth_of(name)
    place = np.round(np.abs(exponents.imag) * period / (2.0 * np.pi), 4)
    return period, exponents, np.isin(place, MUST[name])


def rotor(name: str, noise: float, seed: int) -> Case:
    """Both hits on the lab rotor, synchronous."""
    period, exponents, must = must_of(name)
    hits = []
    for hit in (1, 2):
        record = read(DATA / f"{name}_hit{hit}.npz", period=period)
        values, _ = noisy(record.values, record.values, noise, 10 * seed + hit)
        hits.append(Record(values=values, sample_rate=record.sample_rate, channels=record.channels, clock=record.clock))
    return Case(records=tuple(hits), period=period, exponents=exponents, must=must)


def rotor_650rpm(noise: float, seed: int) -> Case:
    """The slow lab rotor: an exponent folded almost onto zero, harmonics to ±6."""
    return rotor("rotor_650rpm", noise, seed)


def rotor_1900rpm(noise: float, seed: int) -> Case:
    """The fast lab rotor: three pairs of close modes, one near half of the fundamental."""
    return rotor("rotor_1900rpm", noise, seed)


def rotor_650rpm_tach(noise: float, seed: int) -> Case:
    """The first hit on the slow rotor as measured: out of step, a pulse a revolution, imbalance, its own 0.5 % noise.

    What is missing to the noise asked for is added; there is never less than its own.
    """
    period, exponents, must = must_of("rotor_650rpm")
    record = read(DATA / "rotor_650rpm_tach.npz")
    free = read(DATA / "rotor_650rpm_hit1.npz", period=period).values
    values = np.array(record.values)
    values[:-1], _ = noisy(values[:-1], free, np.sqrt(max(noise**2 - HELD**2, 0.0)), seed)
    options = {"tach": "tach", "periods_per_revolution": 2}
    record = replace(record, values=values)
    return Case(records=(record,), period=period, exponents=exponents, must=must, options=options)


def duffing_orbit(noise: float, seed: int) -> Case:
    """A forced Duffing chain that rings about its large orbit, of which nothing is told; half a percent nonlinear."""
    period, exponents = truth_of("duffing_orbit")
    record = read(DATA / "duffing_orbit.npz", period=period)
    free = record.values - np.tile(record.orbit, record.n_samples // record.orbit.shape[1])
    values, _ = noisy(record.values, free, noise, seed)
    record = replace(record, values=values, orbit=None)
    return Case(records=(record,), period=period, exponents=exponents, must=np.ones(len(exponents), bool))
