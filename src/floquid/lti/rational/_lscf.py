"""LSCF, least-squares complex frequency, with a denominator common to all responses or a matrix over the inputs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, final

import numpy as np

from floquid._arrays import BLOCK, Complexes, Floats
from floquid._checks import finite, input_error, integer, wrong_value
from floquid.lti._era import hankel_covariance
from floquid.lti._exponentials import model_of
from floquid.lti._factor import Factor, energetic_length, energies, factors, is_safe, product_noise
from floquid.lti._poles import FASTEST, PoleSet
from floquid.lti._significance import strongest
from floquid.lti._types import AbstractIdentifier, ModalModel, Report, TimeResponses, given_order, reached, silent
from floquid.lti.rational._denominator import (
    SMOOTH,
    Band,
    Basis,
    Denominators,
    Equations,
    Modes,
    Rows,
    chosen,
    model_on,
    stacked,
)

DEGREE = 128  # the roots of a denominator on all lines, if there are twice as many samples: their cost is its cube


DEGREES = 4  # the degree over the order of a scan: well above one, since noise takes most of the roots


@dataclass(frozen=True, slots=True)
class Candidates:
    """Responses, their denominators and the roots of those; the factors where modes are chosen on them."""

    data: TimeResponses
    denominators: Denominators | None
    modes: Modes
    factors: tuple[Factor, ...] = ()

    def at(self, order: int) -> Modes:
        """The plausible roots, from as many directions as the order needs."""
        if self.denominators is None or self.denominators.rank(order) == self.denominators.rank():
            return self.modes
        return candidates(self.denominators, order, shared=self.modes.shares is not None)


def candidates(denominators: Denominators, order: int | None = None, *, shared: bool) -> Modes:
    """The plausible roots of the denominators, with their participations if inputs share those."""
    multipliers, shares = denominators.roots(denominators.rank(order))
    modes = Modes.of(multipliers, shares if shared else None)
    return modes.keep((modes.poles.s.real > FASTEST[0]) & (modes.poles.s.real < FASTEST[1]))


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class LSCF(AbstractIdentifier):
    r"""Least-squares complex frequency: all responses are rational in 1/z, with one denominator.

    .. math:: Y_{oi}(z_l) = \frac{b_{oi}(1/z_l)}{a(1/z_l)}, \qquad
              \min_a \sum_{o,i,l} \left| a\,Y_{oi} - b_{oi} \right|^2 = \min_a a^T (M - M_\text{noise})\, a

    (Van der Auweraer, Guillaume, Verboven and Vanlanduit 2001; Verboven 2002.) The responses are free and finite, so
    that on the lines of their own transform this is exact, numerators one degree below the denominator. Responses are
    divided by their noise. The numerators b_oi are eliminated; what they leave for all responses is the sum of shifted
    blocks of one Gram matrix, so that the size of the problem does not depend on the number of responses.

    The noise is white and of known deviation, and its part of the normal matrix is taken off: the estimate is
    consistent, where plain least squares, its highest coefficient fixed, finds too little damping. The degree is well
    above the order. `extract` asks for `order` poles and gets those roots whose residues take most out of the
    responses. Growing modes are found as decaying ones are; two modes of equal poles are one.

    Parameters
    ----------
    degree
        The degree of the denominator, at most one less than there are samples; None for half of the samples that hold
        energy, at most 128, and in proportion on a band.
    band
        The lines looked at, from one fraction of the Nyquist frequency 1/(2 dt) to another, between 0 and 1; None for
        all. Poles outside are not returned, and the residues of those inside are fitted on the band.
    """

    decides: ClassVar[bool] = False

    degree: int | None = None
    band: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        checked_options(self.degree, self.band, "LSCF")

    def of_order(self, order: int) -> LSCF:
        return self if self.degree is not None else replace(self, degree=DEGREES * order)

    def prepare(self, data: TimeResponses) -> Candidates:
        """The normal matrix of the responses in `data`, and the roots of the denominators in it."""
        blocks = factors(data, energetic_length(energies(data), data))
        bands = [Band(len(block.values), *(self.band or (0.0, 1.0))) for block in blocks]
        if bands[0].size < 2:
            return Candidates(data, None, Modes(PoleSet.empty()))
        degree = degree_for(self.degree, bands[0])
        long = [k for k, band in enumerate(bands) if band.size > degree]
        found = common([blocks[k] for k in long], [bands[k] for k in long], degree)
        return Candidates(data, found, candidates(found, shared=False), blocks)

    def extract(self, state: Candidates, order: int | None = None, *, report: Report = silent) -> ModalModel:
        """The model of those roots in `state`, `order` of them, that take most out of the responses; tells `report`."""
        wanted = given_order(order, self, state.data)
        modes = state.at(wanted)
        report(f"{modes.poles.order} roots of the denominator")
        if self.band is not None:
            rows, modes = rows_of(modes, state.data, self.band)
            modes = chosen(modes, state.data, state.data.noise, rows, wanted)
            return model_on(modes, state.data, state.data.noise, rows, reached(wanted, modes.poles.order))
        poles = strongest(modes.poles, state.factors, wanted)
        return model_of(poles, state.data, outcome=reached(wanted, poles.order))


@final
@dataclass(frozen=True, slots=True, kw_only=True)
class PolyLSCF(AbstractIdentifier):
    r"""Poly-reference least-squares complex frequency: a right matrix fraction, the inputs being the references.

    .. math:: Y_o(z_l)^T = b_o(1/z_l)^T A(1/z_l)^{-1}, \qquad l_r^T A(1/\mu_r) = 0, \qquad
              y_{oi}[k] = \sum_r \psi_{or}\, l_{ri}\, \mu_r^k

    (Guillaume, Verboven, Vanlanduit, Van der Auweraer and Peeters 2003; Peeters, Van der Auweraer, Guillaume and
    Leuridan 2004, known as PolyMAX.) A is square in the inputs: a root comes with its participation l_r, and two
    modes of equal poles have two of them. With one input it is `LSCF`. What is said there of the exact lines, of the
    noise taken off and of the choice among the roots holds here too.

    The fraction asks that the inputs are initial conditions of one system and of equal length: the poles and
    participations come from the samples that all inputs have, the choice of roots and the residues from all samples.
    Noise is brought to one level by a factor an output and a factor an input, for a factor a response would undo the
    participations; what then is left unequal is taken off the normal matrix as it is.

    Parameters
    ----------
    degree
        The degree of the denominator, at most one less than there are samples; None for what the samples that hold
        energy and the number of inputs allow, at most 128. There are `degree` times as many roots as inputs.
    band
        The lines looked at, from one fraction of the Nyquist frequency 1/(2 dt) to another, between 0 and 1; None for
        all. Poles outside are not returned, and the residues of those inside are fitted on the band.
    rank_one
        Whether the residues of a mode are the outer product with its participation; false leaves the inputs
        independent, and modes of equal poles indistinct.
    """

    decides: ClassVar[bool] = False

    degree: int | None = None
    band: tuple[float, float] | None = None
    rank_one: bool = True

    def __post_init__(self) -> None:
        checked_options(self.degree, self.band, "PolyLSCF")

    def of_order(self, order: int) -> PolyLSCF:
        return self if self.degree is not None else replace(self, degree=DEGREES * order)

    def prepare(self, data: TimeResponses) -> Candidates:
        """The normal matrix of the responses in `data`, and the roots of the denominators in it."""
        energy = energies(data)
        samples = min(energetic_length(energy, data), int(data.lengths.min()))
        band = Band(samples, *(self.band or (0.0, 1.0)))
        if band.size < 2:
            return Candidates(data, None, Modes(PoleSet.empty()))
        degree = degree_for(self.degree, band, data.n_inputs)
        if self.degree is None:
            degree = min(degree, max(1, DEGREE // data.n_inputs))
        safe = is_safe(samples, float(energy.sum()), data.n_outputs)
        found = matrix(data, band, degree, safe=safe)
        return Candidates(data, found, candidates(found, shared=True))

    def extract(self, state: Candidates, order: int | None = None, *, report: Report = silent) -> ModalModel:
        """The model of those roots in `state`, `order` of them, that take most out of the responses; tells `report`."""
        wanted = given_order(order, self, state.data)
        data, modes = state.data, state.at(wanted)
        report(f"{modes.poles.order} roots of the denominator")
        rows, modes = rows_of(modes, data, self.band)
        scale = product_noise(data.noise)
        modes = chosen(modes, data, scale, rows, wanted)
        outcome = reached(wanted, modes.poles.order)
        if self.rank_one and data.n_inputs > 1:
            return model_on(modes, data, scale, rows, outcome)
        if self.band is not None:
            return model_on(Modes(modes.poles), data, scale, rows, outcome)
        return model_of(modes.poles, data, outcome=outcome)


def checked_options(degree: int | None, band: tuple[float, float] | None, of: str) -> None:
    """Raise where the options make no sense."""
    if degree is not None:
        integer(degree, "degree", of, at_least=1)
    if band is None:
        return
    if not isinstance(band, tuple) or len(band) != 2:
        raise wrong_value("band", of, "be two fractions of the Nyquist frequency", band)
    low, high = (finite(edge, "band", of) for edge in band)
    if not 0.0 <= low < high <= 1.0:
        remedy = "They are fractions of 1/(2 dt): (0, 1) is all there is."
        raise input_error("band", of, "rise from at least 0 to at most 1", f"is {band}", remedy)


def degree_for(asked: int | None, band: Band, inputs: int = 1) -> int:
    """The degree of a denominator: that asked for as far as the lines go, or one that leaves noise its room."""
    if asked is not None:
        return min(asked, band.size - 1)
    degree = DEGREE if band.whole else int(np.ceil(DEGREE * (band.high - band.low))) + SMOOTH
    return max(1, min(degree, band.size // (1 + inputs)))


def common(blocks: Sequence[Factor], bands: Sequence[Band], degree: int) -> Denominators:
    """The denominators common to all responses, from blocks of more than `degree` samples or lines."""
    safe = all(is_safe(len(b.values), b.energy, b.columns) for b in blocks)
    equations = sum(block.columns * (band.size - degree) for block, band in zip(blocks, bands, strict=True))
    samples, one = bands[0].samples, np.ones(1)
    if bands[0].whole and safe:
        normal = hankel_covariance(blocks, degree + 1)[::-1, ::-1]
        noise = equations * np.eye(degree + 1)
        return Denominators.of(Basis.powers(degree), samples, normal, (noise, one), equations, squared=True)
    basis = Basis.powers(degree) if bands[0].whole else Basis.on(bands[0], degree)
    noise, roots = np.zeros((degree + 1, degree + 1)), []
    for block, band in zip(blocks, bands, strict=True):
        lines = Equations.of(basis, band)
        noise += block.columns * lines.noise()
        roots.append(lines.triangle([band.spectrum(block.values.T)[:, None]]))
    root = np.asarray(np.linalg.qr(np.concatenate(roots), mode="r"))
    return Denominators.of(basis, samples, root, (noise, one), equations, squared=False)


def rows_of(modes: Modes, data: TimeResponses, band: tuple[float, float] | None) -> tuple[list[Rows], Modes]:
    """Data of each input, the modes beside a band taken off; and the modes in it."""
    bands = [Band(int(length), *(band or (0.0, 1.0))) for length in data.lengths]
    inside = bands[0].holds(modes.poles.s)
    return [Rows.of(one, modes.poles.keep(~inside)) for one in bands], modes.keep(inside)


def matrix(data: TimeResponses, band: Band, degree: int, *, safe: bool) -> Denominators:
    """The matrix denominators from the samples that all inputs have; squared where that is `safe`."""
    scale, inputs = product_noise(data.noise), data.n_inputs
    of_inputs = np.sum((data.noise / scale) ** 2, axis=0)
    equations = data.n_outputs * (band.size - degree)
    if band.whole and safe:
        basis = Basis.powers(degree)
        normal = hankel(_blocks(data, scale, band.samples), inputs, band.samples, degree)
        noise = (band.samples - degree) * np.eye(degree + 1)
        return Denominators.of(basis, band.samples, normal, (noise, of_inputs), equations, squared=True)
    basis = Basis.powers(degree) if band.whole else Basis.on(band, degree)
    lines = Equations.of(basis, band)
    root = lines.triangle(_spectra(data, scale, band))
    return Denominators.of(basis, band.samples, root, (lines.noise(), of_inputs), equations, squared=False)


def _blocks(data: TimeResponses, scale: Floats, samples: int) -> Iterator[Floats]:
    """The responses over their scale (outputs, inputs, samples), some outputs at a time."""
    step = max(1, BLOCK // (samples * data.n_inputs))
    for start in range(0, data.n_outputs, step):
        part = slice(start, start + step)
        yield data.values[part, :, :samples] / scale[part, :, None]


def _spectra(data: TimeResponses, scale: Floats, band: Band) -> Iterator[Complexes]:
    """The lines (outputs, inputs, lines), of fewer outputs with the same Gram matrix where there are many."""
    size = 2 * len(band.lines) * data.n_inputs
    right = np.zeros((0, size))
    for block in _blocks(data, scale, band.samples):
        lines = band.spectrum(block)
        if data.n_outputs <= size:
            yield lines
        else:
            rows = stacked(lines).reshape(len(lines), -1)
            right = np.asarray(np.linalg.qr(np.concatenate([right, rows]), mode="r"))
    if len(right):
        real, imaginary = np.split(right.reshape(len(right), data.n_inputs, -1), 2, axis=2)
        yield real + 1j * imaginary


def hankel(blocks: Iterator[Floats], inputs: int, samples: int, degree: int) -> Floats:
    """Σ_o Σ_t y_oi[t-k] y_oj[t-m] over t ≥ degree, (powers and inputs, powers and inputs), the power first."""
    # Its first rows are correlations; along each diagonal the next entry gains one product at the near end and loses
    # one at the far end.
    size = 1 << int(np.ceil(np.log2(samples + degree + 1)))
    cross = np.zeros((inputs, inputs, size // 2 + 1), complex)
    change = np.zeros((degree * inputs, degree * inputs))
    for block in blocks:
        for start in range(0, len(block), max(1, BLOCK // (size * inputs))):
            part = block[start : start + max(1, BLOCK // (size * inputs))]
            late = np.fft.rfft(np.where(np.arange(samples) < degree, 0.0, part), size)
            whole = np.fft.rfft(part, size).conj()
            for i in range(inputs):
                for j in range(inputs):
                    cross[i, j] += np.einsum("ol,ol->l", late[:, i], whole[:, j])
        near = block[:, :, :degree][..., ::-1].transpose(2, 1, 0).reshape(degree * inputs, -1)
        far = block[:, :, samples - degree :][..., ::-1].transpose(2, 1, 0).reshape(degree * inputs, -1)
        change += near @ near.T - far @ far.T
    first = np.fft.irfft(cross, size)[..., : degree + 1]
    steps = change.reshape(degree, inputs, degree, inputs)
    normal = np.zeros((degree + 1, inputs, degree + 1, inputs))
    normal[0] = first.transpose(0, 2, 1)
    for k in range(degree):
        normal[k + 1, :, 0] = first[:, :, k + 1].T
        normal[k + 1, :, 1:] = normal[k, :, :-1] + steps[k]
    whole = normal.reshape((degree + 1) * inputs, -1)
    return 0.5 * (whole + whole.T)
