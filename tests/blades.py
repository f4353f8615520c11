"""Rotors of three equal blades whose constant form is known (Coleman), with the blades in the rotor's frame."""

import numpy as np

from floquid import floquet
from floquid.floquet import FunctionMatrix

OMEGA = 1.3
BLADES = [f"{group}{j}" for group in ("flap", "edge") for j in (1, 2, 3)]
FIXED = ["fa", "ss", "tilt", "yaw"]
CHANNELS = [*BLADES, *FIXED]


def coleman(omega=OMEGA):
    """Stiffness, damping and gyroscopic terms in a0, ac, as of flap and edge and four fixed coordinates; all are m."""
    n = 10
    stiffness, damping = np.zeros((2, n, n))
    for first, own in ((0, 2.9), (3, 5.1)):
        block = slice(first, first + 3)
        stiffness[block, block] = np.diag([own**2, own**2 - omega**2, own**2 - omega**2])
        damping[block, block] = 0.08 * np.eye(3)
        damping[first + 1, first + 2], damping[first + 2, first + 1] = 2.0 * omega, -2.0 * omega
        stiffness[first + 1, first + 2], stiffness[first + 2, first + 1] = 0.08 * omega, -0.08 * omega
    for row, own in enumerate((1.9, 2.2, 7.3, 8.1), start=6):
        stiffness[row, row], damping[row, row] = own**2, 0.05
    for one, other, size in ((0, 6, 0.4), (3, 7, 0.3), (1, 8, 0.5), (2, 9, 0.5), (4, 7, 0.3), (1, 5, 0.4)):
        stiffness[one, other] = stiffness[other, one] = size
    return stiffness, damping


def turning(psi):
    """From a0, ac, as to three blades, with its derivative by the azimuth."""
    psi = psi + 2.0 * np.pi * np.arange(3) / 3
    zero = np.zeros(3)
    return (
        np.stack([np.ones(3), np.cos(psi), np.sin(psi)], axis=1),
        np.stack([zero, -np.sin(psi), np.cos(psi)], axis=1),
    )


def rotor(stiffness, damping, groups=(0, 3), soft=0.0, omega=OMEGA):
    """x' = A(t) x with the blades in the rotor's frame, of a system in a0, ac, as of `groups` that begin there.

    The flap of the first blade lacks `soft` of its stiffness [1/s²].
    """
    n = len(stiffness)
    constant = np.block([[np.zeros((n, n)), np.eye(n)], [-stiffness, -damping]])

    def matrix(t):
        change, slope, second = np.eye(n), np.zeros((n, n)), np.zeros((n, n))
        for first in groups:
            block = slice(first, first + 3)
            change[block, block], slope[block, block] = turning(omega * t)
            second[block, first + 1 : first + 3] = -(omega**2) * change[block, first + 1 : first + 3]
        slope = omega * slope
        whole = np.block([[change, np.zeros((n, n))], [slope, change]])
        rate = np.block([[slope, np.zeros((n, n))], [second, slope]])
        found = (whole @ constant + rate) @ np.linalg.inv(whole)
        found[n, 0] += soft
        return found

    return matrix


def modelled(matrix, channels=CHANNELS, omega=OMEGA):
    known = FunctionMatrix(function=matrix, period=2.0 * np.pi / omega)
    return floquet.modes(known, outputs=np.eye(2 * len(channels))[: len(channels)], channels=channels)
