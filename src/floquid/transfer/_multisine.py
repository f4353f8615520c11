"""Multisines whose lines and sidebands never meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from floquid._arrays import Floats, Integers
from floquid._checks import Rebuilt, frozen_array, input_error, integer, positive
from floquid.core import Channel, ConstantPeriod, Record

ROUNDED = 1e-6
"""The share by which periods and rates are off as they are written: a rate so near is that of whole samples."""

DRAWS = 20  # draws of the phases; the one of least peak is taken


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Multisine(Rebuilt):
    r"""Inputs of a few lines each, for measuring harmonic transfer functions.

    .. math:: u_i(t) = \sum_{k \in K_i} a \cos\Big(\frac{2\pi k t}{J T} + \varphi_k\Big)

    A periodic system answers line k at k + mJ alone, m a whole number. No two lines of all inputs are in one residue
    class modulo J, nor in one class and that of its negative: each line of the response then belongs to one line of one
    input at one harmonic m (Louarroudi, Lataire and Pintelon 2012).

    Parameters
    ----------
    values
        One repeat (inputs, samples).
    sample_rate
        [Hz].
    period
        That of the system, T [s].
    turns
        Periods of the system in a repeat, J.
    lines
        The lines k of each input, ascending.
    spare
        Residue classes modulo J that no line is in: what the response has there is noise or not linear (classes,).
    """

    values: Floats
    sample_rate: float
    period: float
    turns: int
    lines: tuple[Integers, ...]
    spare: Integers

    def __post_init__(self) -> None:
        self._freeze(values=("inputs", "samples"))
        self._freeze(dtype=np.int64, spare=("classes",))
        lines = (frozen_array(own, "lines", "Multisine", axes=("lines",), dtype=np.int64) for own in self.lines)
        object.__setattr__(self, "lines", tuple(lines))

    @property
    def frequencies_hz(self) -> tuple[Floats, ...]:
        """The lines of each input [Hz]."""
        return tuple(own / (self.turns * self.period) for own in self.lines)

    @property
    def peak(self) -> float:
        """The largest value over the rms, of the worst input."""
        return float((np.abs(self.values).max(axis=1) / np.sqrt(np.mean(self.values**2, axis=1))).max())

    def record(self, repeats: int, channels: Sequence[Channel | str] | None = None) -> Record:
        """The inputs over some repeats as a record, to be played, or to be put beside the responses.

        Channels given by name alone are of no motion: a force where the name says so, else "other".

        Raises InputError where `repeats` is not at least 1, or `channels` do not name the inputs.
        """
        integer(repeats, "repeats", "Multisine.record", at_least=1, remedy="Four give a variance.")
        named = [f"u{number}" for number in range(1, len(self.values) + 1)] if channels is None else list(channels)
        return Record(
            values=np.tile(self.values, repeats),
            sample_rate=self.sample_rate,
            channels=[_driving(own) if isinstance(own, str) else own for own in named],
            clock=ConstantPeriod(period=self.period),
        )


def _driving(name: str) -> Channel:
    """The channel of an input, which is no response."""
    own = Channel(name=name)
    return replace(own, quantity="other") if own.quantity == "displacement" else own


def multisine(
    period: float,
    sample_rate: float,
    *,
    turns: int = 128,
    band: tuple[float, float] | None = None,
    inputs: int = 1,
    rms: float = 1.0,
    spare: float = 0.1,
    seed: int = 0,
) -> Multisine:
    """A multisine for a system of a period, of random lines and phases, its inputs interleaved.

    Of each pair of residue classes k and -k modulo `turns` one line is taken, at random in one of as many strips of the
    band; 0 and half of `turns`, which are their own negative, are left out.

    Raises InputError where a repeat is not a whole number of samples, or the band has no line for each input.

    Parameters
    ----------
    period, sample_rate
        T [s], and the rate at which it is played and measured [Hz].
    turns
        Periods in a repeat, J: lines are 1/(JT) apart and there are J/2 at most.
    band
        The lowest and the highest line [Hz]; by default up to a fifth of the rate. Beyond half of it there are none.
    inputs
        Inputs, each with lines of its own.
    rms
        That of each input [its unit].
    spare
        The share of pairs of classes that is left out, for what is not linear to show.
    seed
        Of the random numbers.
    """
    of = "multisine"
    for name, value in (("period", period), ("sample_rate", sample_rate), ("rms", rms)):
        positive(value, name, of, remedy="Give it in s, in Hz, or in the input's unit.")
    integer(turns, "turns", of, at_least=4, remedy="As turns=128.")
    integer(seed, "seed", of, at_least=0, remedy="As seed=0.")
    integer(inputs, "inputs", of, at_least=1, remedy="As inputs=1.")
    if not 0.0 <= spare < 1.0:
        raise input_error("spare", of, "be from 0 to less than 1", f"is {spare}", "As spare=0.1.")
    exact = turns * period * sample_rate
    samples = round(exact)
    if abs(exact - samples) > ROUNDED * exact:
        must = "give a whole number of samples in a repeat"
        rates = " or ".join(f"{count / (turns * period):.10g}" for count in (int(exact), int(exact) + 1))
        raise input_error("sample_rate", of, must, f"gives {exact:.8g} of them", f"Take {rates} Hz, or other turns.")
    low, high = (0.0, 0.2 * sample_rate) if band is None else band
    lowest, highest = max(int(np.ceil(low * turns * period)), 1), int(min(high * turns * period, (samples - 1) // 2))
    generator = np.random.default_rng(seed)
    candidates = np.arange(lowest, highest + 1)
    pairs = np.minimum(candidates % turns, -candidates % turns)
    classes = generator.permutation([one for one in np.unique(pairs) if 0 < 2 * one < turns])
    left_out = round(spare * len(classes))
    if len(classes) - left_out < inputs:
        got = f"has {max(highest - lowest + 1, 0)} lines of {1.0 / (turns * period):.4g} Hz"
        raise input_error("band", of, "have a line for each input", got, "Widen it, or take more turns.")
    chosen = _spread(candidates, pairs, classes[left_out:], generator)
    lines = tuple(chosen[number::inputs] for number in range(inputs))
    values = np.array([_flattest(own, samples, generator) for own in lines])
    spared = np.concatenate([classes[:left_out], turns - classes[:left_out]])
    return Multisine(
        values=rms * values,
        sample_rate=samples / (turns * period),
        period=period,
        turns=turns,
        lines=lines,
        spare=np.sort(spared).astype(np.int64),
    )


def _spread(candidates: Integers, pairs: Integers, classes: Integers, generator: np.random.Generator) -> Integers:
    """One line of each class, ascending, each in a strip of the band of its own where there is such a choice."""
    from scipy.optimize import linear_sum_assignment

    edges = np.linspace(candidates[0], candidates[-1] + 1, len(classes) + 1)
    strips = np.searchsorted(edges, candidates, side="right") - 1
    there = np.zeros((len(classes), len(classes)), bool)
    for row, one in enumerate(classes):
        there[row, strips[pairs == one]] = True
    _, own = linear_sum_assignment(np.where(there, 0.0, len(classes)) + generator.random(there.shape))
    found = []
    for one, strip, met in zip(classes, own, there[np.arange(len(own)), own], strict=True):
        found.append(generator.choice(candidates[(pairs == one) & ((strips == strip) | (not met))]))
    return np.sort(np.array(found, np.int64))


def _flattest(lines: Integers, samples: int, generator: np.random.Generator) -> Floats:
    """Equal amplitudes at some lines, of the phases drawn those of the least peak, with an rms of 1 (samples,)."""
    best, least = np.zeros(samples), np.inf
    for _ in range(DRAWS):
        spectrum = np.zeros(samples // 2 + 1, complex)
        spectrum[lines] = np.exp(2j * np.pi * generator.random(len(lines)))
        values = np.fft.irfft(spectrum, samples)
        values /= np.sqrt(np.mean(values**2))
        if np.abs(values).max() < least:
            best, least = values, float(np.abs(values).max())
    return best
