"""Modes over a speed of which all is known: a lock with itself, one of two modes with each other, and a crossing."""

import numpy as np

from floquid.core import PeriodicModel

CHANNELS = ("a", "b", "c", "d")
REACH = 12  # harmonics of the shapes, on either side
DAMPING, HALF, SUM = 0.1, 0.45, 0.4
"""Damping of the modes, and what couples mode 1 with itself and modes 2 and 3 with each other."""

LOCKED, TOGETHER = (
    np.array([middle - 2.0 * np.sqrt(coupling**2 - DAMPING**2), middle + 2.0 * np.sqrt(coupling**2 - DAMPING**2)])
    for middle, coupling in ((20.0, HALF), (23.0, SUM))
)
"""Where mode 1, and modes 2 and 3, turn unstable and stable again."""


def shape(number):
    generator = np.random.default_rng(100 + number)
    return generator.standard_normal(4) + 1j * generator.standard_normal(4)


def meeting(first, second, coupling, speed):
    """Exponents and amplitudes of z1 e^{i first t} and the mirror image of z2, which meet at the sum of frequencies."""
    middle = 0.5 * (first + second - speed)
    slow = np.array([[-DAMPING + 1j * middle, coupling], [coupling, -DAMPING - 1j * middle]])
    values, vectors = np.linalg.eig(slow)
    return values + 0.5j * (first + speed - second), vectors


def modes(speed):
    """Exponents, one of each pair, lines by harmonic, and which are real multipliers: the one that grows first."""
    lam, (up, down) = meeting(10.0, 10.0, HALF, speed)
    if abs(lam[0].imag - lam[1].imag) < 1e-9:
        first = np.argsort(-lam.real)
        lam, up, down = lam[first], up[first], down[first]
        turned = np.exp(-0.5j * np.angle(up * down))  # so that the shapes are real
        found = [
            (one, {0: u * shape(1), -1: (u * shape(1)).conj()}, True) for one, u in zip(lam, up * turned, strict=True)
        ]
    else:
        k = int(np.argmax(np.abs(up)))
        found = [(lam[k], {0: up[k] * shape(1), -1: down[k] * shape(1).conj()}, False)]
    lam, (up, down) = meeting(6.5, 16.5, SUM, speed)
    k = int(np.argmax(np.abs(up)))
    found += [
        (lam[k], {0: up[k] * shape(2), -1: down[k] * shape(3).conj()}, False),
        (lam[1 - k].conj() + 1j * speed, {0: down[1 - k].conj() * shape(3), -1: (up[1 - k] * shape(2)).conj()}, False),
        (-0.3 + 1j * (16.0 + 0.3 * (speed - 20.0)), {0: shape(4), 1: 0.3 * shape(5)}, False),
    ]
    return found


def labels(speed, without=(), false=0):
    """Numbers of the modes of `known`, one of each pair, in their order; -1 of a false one."""
    found = modes(speed)
    names = [max(0, k - len(found) + 4) for k in range(len(found))]
    return [name for k, name in enumerate(names) if k not in without] + [-1] * false


def noise_lines(generator):
    """Lines of a mode that noise made up."""
    return {m: 0.5 ** abs(m) * (generator.standard_normal(4) + 1j * generator.standard_normal(4)) for m in (-1, 0, 1)}


def known(speed, *, std=0.0, shape_std=0.0, seed=0, channels=CHANNELS, branch=(), without=(), false=0, turn=0.0):
    """The model at a speed ω of the period; `branch` moves modes by harmonics, `turn` phase zero by a share of T."""
    generator = np.random.default_rng(seed)
    lam, shapes, real = [], [], []
    made_up = [
        (complex(-generator.uniform(0.1, 2.0), generator.uniform(5.0, 18.0)), noise_lines(generator), False)
    ] * false
    for k, (exponent, lines, is_real) in enumerate([*modes(speed), *made_up]):
        if k in without:
            continue
        values = np.zeros((4, 2 * REACH + 1), complex)
        for m, line in lines.items():
            values[:, m + REACH] = line / np.sqrt(sum(np.linalg.norm(own) ** 2 for own in lines.values()))
        noise = generator.standard_normal((2, *values.shape)) * shape_std * values.any(axis=0)
        values = values + noise[0] + 1j * noise[1]
        if is_real:
            values[:, REACH - 1] = values[:, REACH].conj()
        shift = branch[k] if k < len(branch) else 0
        off = generator.standard_normal(2) * std * [1.0, not is_real]
        lam.append(exponent + complex(*off) + 1j * speed * shift)
        shapes.append(np.roll(values, -shift, axis=1))
        real.append(is_real)
    pairs = [k for k in range(len(lam)) if not real[k]]
    whole, coefficients = np.array(lam), np.array(shapes)
    whole = np.concatenate([whole, whole[pairs].conj()])
    coefficients = np.concatenate([coefficients, coefficients[pairs].conj()[..., ::-1]])
    variance = std**2 * np.concatenate([np.ones(len(whole)), ~np.array(real), ~np.array(real)[pairs]])
    deviations = np.where(coefficients != 0.0, shape_std * (1 + 1j), 0.0)
    coefficients = coefficients * np.exp(2j * np.pi * turn * np.arange(-REACH, REACH + 1))
    rows = [CHANNELS.index(name) for name in channels]
    return PeriodicModel(
        exponents=whole, coefficients=coefficients[:, rows, None], harmonics=np.arange(-REACH, REACH + 1),
        period=2.0 * np.pi / speed, channels=channels, covariance=np.diag(variance) if std else None,
        coefficient_std=deviations[:, rows, None] if shape_std else None,
    )  # fmt: skip
