"""The Floquet-Lyapunov transform of a known A(t): a change of states that makes it constant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import Floats
from floquid._checks import Rebuilt, input_error, integer
from floquid.floquet.matrices import StateMatrix
from floquid.floquet.monodromy_matrix import _periodic_schur
from floquid.floquet.monodromy_matrix._transition import TOLERANCE, balanced, checked, factors, refuse_lost

_NEGATIVE = 1e-4  # rad: a multiplier that near to the negative axis has a real transform of twice the period


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FloquetLyapunov(Rebuilt):
    r"""A change of states that makes x' = A(t) x constant.

    .. math:: x = P(t)\, z, \qquad \dot z = R\, z, \qquad \Phi(t, 0) = P(t)\, e^{Rt}\, P(0)^{-1}

    Parameters
    ----------
    times
        Equal steps of the period of P (phases,) [s].
    transform
        P at these times, real (phases, n, n).
    constant
        R, real and block diagonal, one block for multipliers of like size (n, n) [1/s].
    period
        The period of P [s]: that of A, or twice it where a real multiplier is negative.
    """

    times: Floats
    transform: Floats
    constant: Floats
    period: float


def floquet_lyapunov(
    system: StateMatrix,
    period: float | None = None,
    *,
    breaks: ArrayLike = (),
    n_phases: int = 64,
    tolerance: float = TOLERANCE,
) -> FloquetLyapunov:
    r"""The real Floquet-Lyapunov transform of A(t), also of a defective one.

    .. math:: R = \frac{\ln \Phi(T, 0)}{T}, \qquad P(t) = \Phi(t, 0)\, e^{-Rt}

    block by block of the periodic Schur form, so that multipliers of very different sizes are kept.

    Floquet 1883; Lyapunov 1892; real with a period of 2T where a real multiplier is negative: Montagnier, Paige and
    Spiteri 2003, "Real Floquet factors of linear time-periodic systems". `system`, `period`, `breaks` and `tolerance`
    are as in `transition`, errors as in `exponents`; `n_phases` is the number of steps in the period of A, at least 1.
    """
    of = "floquet.floquet_lyapunov"
    prepared = checked(system, period, breaks, tolerance, of)
    steps = integer(n_phases, "n_phases", of, at_least=1)
    length = prepared.matrix.period
    found = factors(prepared, length * np.arange(steps + 1) / steps, tolerance, of)
    form = _periodic_schur.schur(balanced(found, prepared))
    logs = _periodic_schur.logarithms(form)
    refuse_lost(logs, found, prepared, of)
    # A double multiplier of -1 comes out as a pair as far apart as the root of rounding.
    doubled = bool((np.abs(np.abs(logs.imag) - np.pi) < _NEGATIVE).any())
    turns = 2 if doubled else 1
    widths = np.tile(found.right - found.left, turns)
    parts = [_block(form, block, widths, turns, length) for block in form.blocks()]
    n = len(prepared.scale)
    constant = np.zeros((n, n))
    for block, (rate, _) in zip(form.blocks(), parts, strict=True):
        constant[block, block] = rate
    nodes = np.searchsorted(np.tile(found.owner, turns) + np.repeat(np.arange(turns), len(found.owner)) * steps,
                            np.arange(turns * steps))  # fmt: skip
    transform = np.concatenate([basis for _, basis in parts], axis=2)[nodes]
    out = np.ascontiguousarray(transform * prepared.scale[:, None])
    times = length * np.arange(turns * steps) / steps
    for array in (out, constant, times):
        array.flags.writeable = False
    return FloquetLyapunov(times=times, transform=out, constant=constant, period=turns * length)


def _block(
    form: _periodic_schur.PeriodicSchur, block: slice, widths: Floats, turns: int, period: float
) -> tuple[Floats, Floats]:
    r"""R of one diagonal block (m, m), and the columns of P at the nodes of `turns` periods (nodes, n, m).

    The own part is :math:`W_{2,k+1} = T_{22,k} W_{2,k} e^{-R h_k}`; the part in the columns before it is carried
    backwards, in which direction its errors decay, over as many periods as it takes to forget where it began.
    """
    from scipy.linalg import expm, logm

    count = len(form.bases)
    inner = form.triangles[:, block, block]
    product, taken = _periodic_schur.scaled_product(inner)
    size = product.shape[0]
    whole = np.linalg.matrix_power(product, turns)
    found = np.asarray(logm(whole), dtype=np.complex128)
    if np.abs(found.imag).max() > 1e-9 * max(1.0, np.abs(found.real).max()):
        must = "have a real logarithm of its transition over two periods"
        got = "multipliers at ±i stand beside negative ones"
        remedy = "Use `floquet.modes`, whose shapes are complex."
        raise input_error("system", "floquet.floquet_lyapunov", must, got, remedy)
    rate = found.real / (turns * period) + taken / period * np.eye(size)
    backs = np.stack([expm(-rate * width) for width in widths[:count]])
    ahead = np.stack([expm(rate * width) for width in widths[:count]])
    total = turns * count
    second = np.empty((total + 1, size, size))
    second[0] = np.eye(size)
    for k in range(total):
        second[k + 1] = inner[k % count] @ second[k] @ backs[k % count]
    first = np.zeros((total + 1, block.start, size))
    if block.start:
        before = slice(0, block.start)
        inverses = np.linalg.inv(form.triangles[:, before, before])
        for _ in range(_periodic_schur.PASSES):
            last = first[0].copy()
            first[total] = last
            for k in range(total - 1, -1, -1):
                at = k % count
                forcing = form.triangles[at, before, block] @ second[k]
                first[k] = inverses[at] @ (first[k + 1] @ ahead[at] - forcing)
            if np.abs(first[0] - last).max() <= 1e-15 * max(1.0, np.abs(last).max()):
                break
    inside = np.concatenate([first, second], axis=1)[:-1]
    bases = np.concatenate([form.bases] * turns)[:, :, : block.stop]
    return rate, bases @ inside
