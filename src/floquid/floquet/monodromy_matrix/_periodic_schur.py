r"""Eigenvalues and eigenvectors of a product of matrices that is never formed.

.. math:: M = F_{K-1} \cdots F_1 F_0, \qquad F_k Q_k = Q_{k+1} T_k, \qquad Q_K = Q_0

with orthogonal Q and block upper triangular T, the periodic Schur form (Bojanczyk, Golub and Van Dooren 1992), whose
diagonal blocks have eigenvalues of like size: a block's product loses nothing when it is multiplied out, the whole
product's small eigenvalues are lost to rounding. It is found by orthogonal iteration (Golub and Van Loan, Matrix
Computations, 7.3.2), which converges as quickly as the sizes differ, and is needed only where they do.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from floquid._arrays import Complexes, Floats, Indices

SPREAD = 1e3  # ratio of eigenvalues within a block that is left together: three digits of sixteen
CLEAN = 1e-14  # coupling below the diagonal that counts as none
TURNED = 8.0 * np.finfo(float).eps  # the share of π that is rounding in an angle
PASSES = 400  # of the orthogonal iteration


class PeriodicSchur(NamedTuple):
    """The periodic Schur form of K factors."""

    bases: Floats  # Q_k (K, n, n)
    triangles: Floats  # T_k (K, n, n)
    starts: tuple[int, ...]  # the first column of each diagonal block

    def blocks(self) -> list[slice]:
        """The columns of each diagonal block, those of the largest eigenvalues first."""
        ends = (*self.starts[1:], self.bases.shape[1])
        return [slice(start, end) for start, end in zip(self.starts, ends, strict=True)]


class ProductModes(NamedTuple):
    """Eigenvalues of the product, as logarithms, and eigenvectors at every node."""

    logarithms: Complexes  # log μ, the imaginary part in (-π, π] (modes,)
    vectors: Complexes  # x_k of unit length (nodes 0 to K, n, modes)
    growth: Floats  # ln ‖F_{k-1} ... F_0 x_0‖ (nodes 0 to K, modes): F_k x_k exp(growth_k) = x_{k+1} exp(growth_{k+1}).


def schur(factors: Floats) -> PeriodicSchur:
    """The periodic Schur form of the factors (K, n, n), F_0 the first to act."""
    count, n, _ = factors.shape
    plain = PeriodicSchur(np.broadcast_to(np.eye(n), factors.shape), factors, (0,))
    if n == 1 or _spread(factors) <= SPREAD:
        return plain
    first = _start(factors)
    best: PeriodicSchur | None = None
    for _ in range(PASSES):
        bases, triangles = np.empty_like(factors), np.empty_like(factors)
        q = first
        for k in range(count):
            bases[k] = q
            q, triangles[k] = np.linalg.qr(factors[k] @ q)
        turn = first.T @ q
        coupling = np.array([np.abs(turn[i:, :i]).max() for i in range(1, n)])
        starts = (0, *(np.flatnonzero(coupling <= CLEAN * n) + 1).tolist())
        if best is None or len(starts) >= len(best.starts):
            for start in starts[1:]:
                turn[start:, :start] = 0.0
            triangles[-1] = turn @ triangles[-1]
            best = PeriodicSchur(bases, triangles, starts)
            if all(_spread(triangles[:, block, block]) <= SPREAD for block in best.blocks()):
                break
        first = q
    assert best is not None
    return best


def logarithms(form: PeriodicSchur) -> Complexes:
    """The logarithms of the eigenvalues of the product, block by block (n,)."""
    return np.concatenate([_eigen(form.triangles[:, block, block])[0] for block in form.blocks()])


def principal_order(logs: Complexes) -> Indices:
    """The order of the exponents: by angle, then by falling size, positive angles first."""
    angle = np.abs(logs.imag)
    # Conjugates have the same angle to the last digit; others that differ by rounding alone keep their sizes' order.
    return np.lexsort((-logs.imag, -logs.real, angle))


def product_logarithms(factors: Floats) -> Complexes:
    """The logarithms of the eigenvalues of a product of factors (factors, n, n), in the order of `exponents` (n,)."""
    found = logarithms(schur(factors))
    return found[principal_order(found)]


def product_shapes(factors: Floats) -> tuple[Complexes, Complexes]:
    r"""The logarithms l of the eigenvalues of a product of K factors (n,), and periodic shapes (factors, n, modes).

    .. math:: F_k\, p_k = e^{l/K}\, p_{k+1}, \qquad p_K = p_0
    """
    found = modes(schur(factors))
    order = principal_order(found.logarithms)
    return found.logarithms[order], periodic_shapes(found, np.arange(len(factors)))[:, :, order]


def periodic_shapes(found: ProductModes, nodes: Indices) -> Complexes:
    """Shapes x_k exp(growth_k - λ t_k) (phases, n, modes) from eigenvectors at the nodes of equal phases."""
    share = np.arange(len(nodes))[:, None] / len(nodes)
    # The two terms are large and nearly equal: they are taken apart before the exponential.
    real = found.growth[nodes] - share * found.logarithms.real
    return found.vectors[nodes] * np.exp(real - 1j * share * found.logarithms.imag)[:, None, :]


def multipliers_of(logs: Complexes) -> Complexes:
    """Multipliers from their logarithms (n,): real where these say so, zero and infinite out of range."""
    # A real multiplier that overflows is infinite, and not infinity times the zero of a sine.
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        size = np.exp(logs.real)
        real = np.where(logs.imag == 0.0, size, -size)
        return np.where(np.isin(logs.imag, (0.0, np.pi)), real, size * np.exp(1j * logs.imag))


def modes(form: PeriodicSchur) -> ProductModes:
    """The eigenvalues of the product and its eigenvectors, carried through the factors."""
    logs, vectors, growth = zip(*(_block_modes(form, block) for block in form.blocks()), strict=True)
    return ProductModes(np.concatenate(logs), np.concatenate(vectors, axis=2), np.concatenate(growth, axis=1))


def scaled_product(factors: Floats) -> tuple[Floats, float]:
    """The product with its largest entry made one, and the logarithm of what was taken out."""
    out, taken = np.eye(factors.shape[1]), 0.0
    for factor in factors:
        out = factor @ out
        size = float(np.abs(out).max())
        if size == 0.0:
            return out, -np.inf
        out, taken = out / size, taken + np.log(size)
    return out, taken


def _spread(factors: Floats) -> float:
    """The largest eigenvalue of the product over the smallest; rounding alone when that is very large."""
    if factors.shape[1] == 1:
        return 1.0
    sizes = np.abs(np.linalg.eigvals(scaled_product(factors)[0]))
    return float(sizes.max() / sizes.min()) if sizes.min() > 0.0 else np.inf


def _start(factors: Floats) -> Floats:
    """An orthogonal basis of the eigenvectors of the product as rounding has it, the largest eigenvalue first."""
    values, vectors = _eig(scaled_product(factors)[0])
    order = np.lexsort((values.imag < 0.0, -np.round(np.log(np.abs(values) + 1e-300), 9)))
    columns = np.where(values.imag < 0.0, vectors.imag, vectors.real)[:, order]
    # A fixed full-rank part, far below the columns, keeps the basis whole where they are dependent.
    filled = columns + 1e-9 * np.eye(len(columns))
    return np.linalg.qr(filled)[0]


def _eigen(factors: Floats) -> tuple[Complexes, Complexes]:
    """The logarithms of the eigenvalues of the product and its eigenvectors at node 0."""
    product, taken = scaled_product(factors)
    values, vectors = _eig(product)
    with np.errstate(divide="ignore"):
        logs = np.asarray(np.log(values) + taken, dtype=np.complex128)
    logs.imag[logs.imag <= -np.pi * (1.0 - TURNED)] = np.pi  # a negative multiplier whose imaginary part is rounding
    return logs, vectors


def _eig(matrix: Floats) -> tuple[Complexes, Complexes]:
    """Eigenvalues and eigenvectors, complex also where they are real."""
    values, vectors = np.linalg.eig(matrix)
    return np.asarray(values, dtype=np.complex128), np.asarray(vectors, dtype=np.complex128)


def _block_modes(form: PeriodicSchur, block: slice) -> tuple[Complexes, Complexes, Floats]:
    r"""The modes of one diagonal block.

    Its own part w₂ is carried forwards through T₂₂. The part in the columns before it belongs to larger eigenvalues and
    is carried backwards, in which direction these decay:

    .. math:: w_{1,k} = T_{11,k}^{-1} \left(\sigma_k w_{1,k+1} - T_{12,k} w_{2,k}\right), \qquad
              w_{1,K} = e^{i\theta} w_{1,0}
    """
    count = len(form.bases)
    inner = form.triangles[:, block, block]
    before = slice(0, block.start)
    logs, own = _eigen(inner)
    width = own.shape[1]
    second = np.empty((count + 1, width, width), dtype=np.complex128)
    sigma = np.empty((count, width))
    second[0] = own / np.linalg.norm(own, axis=0)
    for k in range(count):
        following = inner[k] @ second[k]
        sigma[k] = np.linalg.norm(following, axis=0)
        second[k + 1] = following / sigma[k]
    first = np.zeros((count + 1, block.start, width), dtype=np.complex128)
    if block.start:
        inverses = np.asarray(np.linalg.inv(form.triangles[:, before, before]), dtype=np.float64)
        forcing = form.triangles[:, before, block] @ second[:-1]

        def backwards(last: Complexes) -> None:
            first[count] = last
            for k in range(count - 1, -1, -1):
                first[k] = inverses[k] @ (first[k + 1] * sigma[k] - forcing[k])

        backwards(first[count])
        home, taken = scaled_product(inverses[::-1])
        turn = np.exp(1j * logs.imag)
        share = np.exp(logs.real + taken) * turn
        start = np.stack(
            [np.linalg.solve(np.eye(block.start) - share[r] * home, first[0][:, r]) for r in range(width)], axis=1
        )
        backwards(start * turn)
    whole = np.concatenate([first, second], axis=1)
    bases = np.concatenate([form.bases, form.bases[:1]])[:, :, : block.stop]
    vectors = bases @ whole
    lengths = np.linalg.norm(vectors, axis=1)
    steps = np.concatenate([np.zeros((1, width)), np.cumsum(np.log(sigma), axis=0)])
    return logs, vectors / lengths[:, None, :], steps + np.log(lengths / lengths[0])
