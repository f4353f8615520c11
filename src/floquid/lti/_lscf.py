"""LSCF, least-squares complex frequency: one denominator common to all responses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np

from floquid._checks import finite, input_error, integer
from floquid.lti._denominator import Band, Basis, Denominators, Equations
from floquid.lti._factor import SAFE, Factor, energies, factors
from floquid.lti._hankel import hankel_covariance
from floquid.lti._horizon import energetic_length
from floquid.lti._identifier import AbstractIdentifier
from floquid.lti._lines import Modes, Rows, chosen, model_on
from floquid.lti._order import checked_order, reached
from floquid.lti._poles import PoleSet
from floquid.lti._removal import strongest
from floquid.lti._residues import model_of
from floquid.lti._select import FASTEST
from floquid.lti._types import ModalModel, TimeResponses

DEGREE = 128
"""The degree of the denominator on all lines, if there are twice as many samples."""

EXTRA = 16
"""What is added on a band, for the skirts of the modes outside."""


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
        blocks = factors(data, energetic_length(energies(data), data))
        bands = [Band(len(block.values), *(self.band or (0.0, 1.0))) for block in blocks]
        if bands[0].size < 2:
            return Candidates(data, None, Modes(PoleSet.empty()))
        degree = degree_for(self.degree, bands[0])
        long = [k for k, band in enumerate(bands) if band.size > degree]
        found = common([blocks[k] for k in long], [bands[k] for k in long], degree)
        return Candidates(data, found, candidates(found, shared=False), blocks)

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
        modes = state.at(wanted)
        report(f"{modes.poles.order} roots of the denominator")
        if self.band is not None:
            rows, modes = rows_of(modes, state.data, self.band)
            modes = chosen(modes, state.data, state.data.noise, rows, wanted)
            return model_on(modes, state.data, state.data.noise, rows, reached(order, modes.poles.order))
        poles = strongest(modes.poles, state.factors, wanted)
        return model_of(poles, state.data, outcome=reached(order, poles.order))

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


def checked_options(degree: int | None, band: tuple[float, float] | None, of: str) -> None:
    """Raise where the options make no sense."""
    if degree is not None:
        integer(degree, "degree", of, at_least=1)
    if band is None:
        return
    if not isinstance(band, tuple) or len(band) != 2:
        raise input_error("band", of, "be two fractions of the Nyquist frequency", f"is {band!r}")
    low, high = (finite(edge, "band", of) for edge in band)
    if not 0.0 <= low < high <= 1.0:
        remedy = "They are fractions of 1/(2 dt): (0, 1) is all there is."
        raise input_error("band", of, "rise from at least 0 to at most 1", f"is {band}", remedy)


def degree_for(asked: int | None, band: Band, inputs: int = 1) -> int:
    """The degree of a denominator: that asked for as far as the lines go, or one that leaves noise its room."""
    if asked is not None:
        return min(asked, band.size - 1)
    degree = DEGREE if band.whole else int(np.ceil(DEGREE * (band.high - band.low))) + EXTRA
    return max(1, min(degree, band.size // (1 + inputs)))


def common(blocks: Sequence[Factor], bands: Sequence[Band], degree: int) -> Denominators:
    """The denominators common to all responses, from blocks of more than `degree` samples or lines."""
    safe = all(len(b.values) * np.finfo(float).eps * b.energy < SAFE * b.columns for b in blocks)
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
    """What each input is looked at through, the modes beside a band taken off; and the modes in it."""
    bands = [Band(int(length), *(band or (0.0, 1.0))) for length in data.lengths]
    inside = bands[0].holds(modes.poles.s)
    return [Rows.of(one, modes.poles.keep(~inside)) for one in bands], modes.keep(inside)
