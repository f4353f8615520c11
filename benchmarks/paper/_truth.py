"""The paper's rotor by its equations: the oracle's exponents and residues, and where it is unstable."""

from __future__ import annotations

from functools import cache

import numpy as np

from floquid import floquet
from floquid._arrays import Complexes
from floquid.core import PeriodicModel, Provenance
from floquid.systems import JeffcottRotor

PHASES = 128
"""Phases at which the exact residues are expanded: their harmonics are below 1e-15 long before the half of it."""

SLOWEST, FASTEST, STEP = 0.68, 0.96, 0.01
"""The speeds searched for instability, in steps smaller than the bands and the gaps between them."""

EDGE = 1e-6  # to how much of a speed the edges of the bands are found


def exact_model(rotor: JeffcottRotor, impulse_deg: float = 45.0) -> PeriodicModel:
    r"""The response of the rotor to a unit impulse at phase zero, from its transition matrix.

    .. math:: R_r(t) = C(t)\, \Phi(t, 0)\, v_r\, e^{-\lambda_r t}\, L_r\, x(0), \qquad \Phi(T, 0) = V e^{\Lambda T} L

    (Allen 2009, eqs. 3-6), on the branch next to the natural frequencies of the shaft held still. It shares no code
    with the identification.
    """
    times = rotor.period * np.arange(PHASES + 1) / PHASES
    phi = floquet.transition(rotor.system, rotor.period, times)
    multipliers, vectors = np.linalg.eig(phi[-1])
    angle = np.deg2rad(impulse_deg)
    start = np.array([0.0, 0.0, np.cos(angle), np.sin(angle)])
    exponents = _physical(rotor, np.asarray(np.log(multipliers) / rotor.period, dtype=np.complex128))
    t = times[:-1]
    shapes = rotor.outputs(t) @ phi[:-1] @ (vectors * np.linalg.solve(vectors, start))
    residues = shapes * np.exp(-np.multiply.outer(t, exponents))[:, None, :]
    harmonics = np.arange(-PHASES // 2, PHASES // 2)
    coefficients = np.fft.fftshift(np.fft.fft(residues, axis=0), axes=0) / PHASES
    order = sorted(range(len(exponents)), key=lambda r: (round(abs(exponents[r]), 9), -exponents[r].imag))
    return PeriodicModel(
        exponents=exponents[order],
        coefficients=coefficients.transpose(2, 1, 0)[order][:, :, None, 1:],
        harmonics=harmonics[1:],  # the lowest has no mirror image
        period=rotor.period,
        channels=rotor.channels,
        provenance=Provenance(sources=(f"the equations of {rotor!r}",)),
    )


def _physical(rotor: JeffcottRotor, exponents: Complexes) -> Complexes:
    """Each exponent moved by whole fundamentals to where |Im λ| is nearest to the frequencies of the still shaft."""
    middle = float(np.mean(frozen_range(rotor)))
    fundamental = 2.0 * np.pi / rotor.period
    turns = np.arange(-4, 5)
    branches = exponents[:, None] + 1j * fundamental * turns
    nearest = np.argmin(np.abs(np.abs(branches.imag) - middle), axis=1)
    return branches[np.arange(len(exponents)), nearest]


def frozen_range(rotor: JeffcottRotor) -> tuple[float, float]:
    """The lowest and the highest natural frequency of the rotor with its shaft held still, over all angles."""
    frequencies = rotor.frozen_frequencies(np.linspace(0.0, np.pi, 721))
    return float(frequencies.min()), float(frequencies.max())


@cache
def instability_edges() -> tuple[float, ...]:
    """The speeds at which the paper's rotor gains or loses its stability, ascending, by its Floquet exponents."""
    from scipy.optimize import brentq

    def growth(speed: float) -> float:
        return float(JeffcottRotor(speed=speed).exponents().real.max())

    speeds = np.arange(SLOWEST, FASTEST, STEP)
    signs = np.sign([growth(speed) for speed in speeds])
    crossings = np.flatnonzero(signs[1:] != signs[:-1])
    return tuple(brentq(growth, speeds[k], speeds[k + 1], xtol=EDGE) for k in crossings)  # type: ignore[misc]
