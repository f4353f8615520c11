"""Hill's matrix: the state equation in harmonics, truncated; in exponentials, or real in cosines and sines."""

from __future__ import annotations

import numpy as np

from floquid._arrays import Complexes, Floats


def block_toeplitz(coefficients: Complexes, n_harmonics: int) -> Complexes:
    """The product with M(t) in harmonics: block (k, m) is M_{k-m}, k and m from -N to N.

    The coefficients (rows, columns, 2 M + 1) reach to M of at least 2 N; the matrix goes harmonic by harmonic.
    """
    rows, columns, count = coefficients.shape
    index = np.arange(2 * n_harmonics + 1)
    blocks = coefficients[..., count // 2 + index[:, None] - index[None, :]]
    return blocks.transpose(2, 0, 3, 1).reshape(len(index) * rows, len(index) * columns)


def real_hill(coefficients: Complexes, n_harmonics: int, fundamental: float) -> Floats:
    """Hill's matrix of a real A(t) in cosines and sines, unitarily similar to A_{k-m} - i m ω δ_{km}.

    With q_m = (c_m - i s_m)/√2 and q_{-m} = (c_m + i s_m)/√2 the unknowns are c_0..c_N, then s_1..s_N. It is real, so
    that its eigenvalues are conjugate in pairs exactly. A_m as in `block_toeplitz` [1/s].
    """
    n, _, count = coefficients.shape
    m = np.arange(n_harmonics + 1)
    weight = np.where(m == 0, np.sqrt(0.5), 1.0)
    less = coefficients[..., count // 2 + m[:, None] - m[None, :]] * (weight[:, None] * weight)
    more = coefficients[..., count // 2 + m[:, None] + m[None, :]] * (weight[:, None] * weight)
    cos_cos, cos_sin = less.real + more.real, (less.imag - more.imag)[..., :, 1:]
    sin_cos, sin_sin = -(less.imag + more.imag)[..., 1:, :], (less.real - more.real)[..., 1:, 1:]
    blocks = np.concatenate(
        [np.concatenate([cos_cos, cos_sin], axis=3), np.concatenate([sin_cos, sin_sin], axis=3)], axis=2
    )
    size = (2 * n_harmonics + 1) * n
    matrix = np.ascontiguousarray(blocks.transpose(2, 0, 3, 1)).reshape(size, size)
    cosine, sine = np.arange(n, (n_harmonics + 1) * n), np.arange((n_harmonics + 1) * n, size)
    speed = np.repeat(fundamental * m[1:], n)
    matrix[cosine, sine] -= speed
    matrix[sine, cosine] += speed
    return matrix


def speeds(n: int, n_harmonics: int, fundamental: float) -> Complexes:
    """The diagonal i k ω of n states, harmonic by harmonic from -N to N ((2 N + 1) n,) [1/s]."""
    return np.asarray(1j * fundamental * np.repeat(np.arange(-n_harmonics, n_harmonics + 1), n), dtype=np.complex128)


def modulo(differences: Complexes, fundamental: float) -> Complexes:
    """Differences of exponents with the nearest multiple of iω taken off, of any shape (...) [1/s]."""
    turns = np.round(np.imag(differences) / fundamental)
    return np.asarray(differences - 1j * fundamental * turns, dtype=np.complex128)


def in_exponentials(vectors: Complexes, n: int) -> Complexes:
    """Vectors in cosines and sines (size, vectors) as coefficients of e^{imωt} (vectors, n, 2 N + 1)."""
    blocks = vectors.reshape(-1, n, vectors.shape[1]).transpose(2, 1, 0)
    n_harmonics = blocks.shape[2] // 2
    cosine, sine = blocks[..., 1 : n_harmonics + 1], blocks[..., n_harmonics + 1 :]
    above, below = np.sqrt(0.5) * (cosine - 1j * sine), np.sqrt(0.5) * (cosine + 1j * sine)
    return np.concatenate([below[..., ::-1], blocks[..., :1], above], axis=2)
