"""Poly-reference LSCF: a matrix denominator over the inputs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
from numpy.typing import NDArray

from floquid.lti._denominator import Band, Basis, Denominators, Equations, stacked
from floquid.lti._factor import BLOCK, SAFE, energies
from floquid.lti._horizon import energetic_length
from floquid.lti._identifier import AbstractIdentifier
from floquid.lti._lines import Modes, chosen, model_on
from floquid.lti._lscf import Candidates, candidates, checked_options, degree_for, rows_of
from floquid.lti._noise import product_noise
from floquid.lti._order import checked_order, reached
from floquid.lti._poles import PoleSet
from floquid.lti._residues import model_of
from floquid.lti._types import ModalModel, TimeResponses

LARGEST = 192
"""The number of roots up to which a degree is chosen: their cost grows with its cube."""

LEAST = 16
"""The degree that is chosen all the same."""


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

    def prepare(self, data: TimeResponses) -> Candidates:
        """The normal matrix, and the roots of the denominators in it.

        Parameters
        ----------
        data
            The responses and their noise.

        Returns
        -------
        Candidates
            What `extract` starts from.
        """
        energy = energies(data)
        samples = min(energetic_length(energy, data), int(data.lengths.min()))
        band = Band(samples, *(self.band or (0.0, 1.0)))
        if band.size < 2:
            return Candidates(data, None, Modes(PoleSet.empty()))
        degree = degree_for(self.degree, band, data.n_inputs)
        if self.degree is None:
            degree = min(degree, max(LEAST, LARGEST // data.n_inputs))
        safe = samples * np.finfo(float).eps * energy.sum() < SAFE * data.n_outputs
        found = matrix(data, band, degree, safe=bool(safe))
        return Candidates(data, found, candidates(found, shared=True))

    def extract(
        self, state: Candidates, order: int | None = None, *, report: Callable[[str], None] = lambda _: None
    ) -> ModalModel:
        """The model of the roots that take most out of the responses.

        Parameters
        ----------
        state
            What `prepare` returned.
        order
            The number of poles, conjugates one by one.
        report
            Is told of each stage.

        Returns
        -------
        ModalModel
            The model; its `outcome` says whether there were as many poles.

        Raises
        ------
        InputError
            `order` is None, or not a positive integer below the number of samples.
        """
        wanted = checked_order(order, self, state.data) or 0
        data, modes = state.data, state.at(wanted)
        report(f"{modes.poles.order} roots of the denominator")
        rows, modes = rows_of(modes, data, self.band)
        scale = product_noise(data.noise)
        modes = chosen(modes, data, scale, rows, wanted)
        outcome = reached(order, modes.poles.order)
        if self.rank_one and data.n_inputs > 1:
            return model_on(modes, data, scale, rows, outcome)
        if self.band is not None:
            return model_on(Modes(modes.poles), data, scale, rows, outcome)
        return model_of(modes.poles, data, outcome=outcome)

    def refine(self, state: Candidates, model: ModalModel) -> ModalModel:
        """The model of the same order: an algorithm of roots starts nowhere.

        Parameters
        ----------
        state
            What `prepare` returned for the data.
        model
            Whose order it is.

        Returns
        -------
        ModalModel
            The model.
        """
        return self.extract(state, model.order) if model.order else model


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


def _blocks(data: TimeResponses, scale: NDArray[np.float64], samples: int) -> Iterator[NDArray[np.float64]]:
    """The responses over their scale (outputs, inputs, samples), some outputs at a time."""
    step = max(1, BLOCK // (samples * data.n_inputs))
    for start in range(0, data.n_outputs, step):
        part = slice(start, start + step)
        yield data.values[part, :, :samples] / scale[part, :, None]


def _spectra(data: TimeResponses, scale: NDArray[np.float64], band: Band) -> Iterator[NDArray[np.complex128]]:
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


def hankel(blocks: Iterator[NDArray[np.float64]], inputs: int, samples: int, degree: int) -> NDArray[np.float64]:
    r"""Σ_o Σ_t y_oi[t-k] y_oj[t-m] over t ≥ degree, (powers and inputs, powers and inputs), the power first.

    Its first rows are correlations; along each diagonal the next entry gains one product at the near end and loses one
    at the far end.
    """
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
