"""Is the system periodic at all? One test of all harmonics beside the zeroth, and what it could have missed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from floquid._arrays import Complexes, Floats, Indices, Integers, Mask
from floquid._checks import Rebuilt, finite, input_error, wrong_value
from floquid.core import Estimates, PeriodicModel
from floquid.findings import Finding, note, texts, warning
from floquid.fit import RARE, SURE, covariance_root
from floquid.lifting import Lifted
from floquid.periodic.significance._wald import holm, noncentrality, spacing_probability, wald
from floquid.search import NEAR

HARMONICS = (1, 2)
"""Harmonics per period that are looked at: stiffness that varies once or twice a period shows in these first."""

LEVEL = 0.05  # the probability at which chance may pass for periodicity
POWER = 1.0 - LEVEL  # the probability with which what lies above a detection limit is seen


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PartialTests(Rebuilt):
    """Tests on parts of the harmonics, one a harmonic, a mode or a channel.

    Parameters
    ----------
    statistics, degrees, p_values
        The chi-square of each, its degrees of freedom, and its probability under the null hypothesis (parts,).
    adjusted
        The probabilities corrected for the number of all parts of the table: harmonics, modes and channels (Holm 1979).
    """

    statistics: Floats
    degrees: Integers
    p_values: Floats
    adjusted: Floats

    def __post_init__(self) -> None:
        self._freeze(dtype=np.int64, degrees=("parts",))
        self._freeze(statistics=("parts",), p_values=("parts",), adjusted=("parts",))

    @property
    def strongest(self) -> int:
        """The part that departs most from what chance gives."""
        return int(np.argmax(self.statistics - self.degrees))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Periodicity(Rebuilt):
    r"""Test of whether a response is that of a periodic system.

    The null hypothesis is a constant system seen by sensors that stand still in it: of every mode the zeroth harmonic
    alone is there. A sensor that moves periodically, such as one that scans, makes the response periodic as well.

    Raises InputError where a shape is not possible.

    Parameters
    ----------
    statistic, degrees, p_value
        The chi-square over all harmonics tested, its degrees of freedom, and the probability of such a value or a
        larger one under the null hypothesis.
    level, power
        The probability at which chance may pass for periodicity, and that with which what is above `limits` is seen.
    harmonics
        The harmonics tested, each on both sides, per period (harmonics,).
    exponents
        Those of the modes, of a conjugate pair that of positive imaginary part (modes,) [1/s].
    channels
        The names of the channels.
    by_harmonic, by_mode, by_channel
        The test on each harmonic, each mode and each channel alone.
    sizes
        The size of each harmonic, both sides, as a share of the mode's zeroth, all channels and hits together weighted
        by the inverse of their noise, and noise taken off (modes, harmonics); NaN where it was not tested.
    limits
        The share above which a harmonic is seen with the probability `power`, whatever its shape, if it alone is there
        (modes, harmonics); NaN where it was not tested.
    untested
        Mode and harmonic m of what could not be tested, since it is beyond what the sampling shows, was not fitted, or
        lies on a mode (cases, 2).
    locked
        Modes whose multipliers are real and folded at the same half or whole fundamental as another's: a constant
        system has that only by chance, but it is no part of the test.
    spacing_p
        The probability of the responses if what was taken for harmonics lies whole numbers of fundamentals from its
        mode. A small one says that modes of a constant system were merged. None where it was not looked at.
    """

    statistic: float
    degrees: int
    p_value: float
    level: float
    power: float
    harmonics: Integers
    exponents: Complexes
    channels: tuple[str, ...]
    by_harmonic: PartialTests
    by_mode: PartialTests
    by_channel: PartialTests
    sizes: Floats
    limits: Floats
    untested: Integers
    locked: Integers
    spacing_p: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", tuple(self.channels))
        self._freeze(dtype=np.int64, harmonics=("harmonics",), untested=("cases", 2), locked=("modes",))
        self._freeze(dtype=np.complex128, exponents=("modes",))
        shape = (len(self.exponents), len(self.harmonics))
        self._freeze(finite=False, sizes=shape, limits=shape)

    @property
    def periodic(self) -> bool | None:
        """True where the null hypothesis is refused at `level`; None where harmonics are not where they would be."""
        refused = self.p_value <= self.level
        return None if refused and self.spacing_p is not None and self.spacing_p < RARE else refused

    @property
    def sentences(self) -> tuple[str, ...]:
        """The result in words: the verdict, then what it does not speak for."""
        return texts(self.findings)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The verdict, then what it does not speak for."""
        findings = [self._verdict()]
        if len(self.untested):
            modes, harmonics = self.untested.T
            findings.append(note("untested", modes=modes + 1, harmonics=harmonics))
        if len(self.locked):
            findings.append(note("locked", modes=self.locked + 1))
        return tuple(findings)

    def _verdict(self) -> Finding:
        if not self.degrees:
            return note("periodic_untestable")
        if self.periodic is None:
            return warning("periodic_untold", p=self.p_value, spacing=self.spacing_p)
        if not self.periodic:
            return self._limits()
        parts = (self.by_harmonic, self.by_mode, self.by_channel)
        strongest = [part.strongest if part.adjusted[part.strongest] <= self.level else None for part in parts]
        harmonic, mode, channel = strongest
        return note(
            "periodic",
            p=self.p_value,
            harmonic=0 if harmonic is None else self.harmonics[harmonic],
            mode=0 if mode is None else mode + 1,
            channel="" if channel is None else self.channels[channel],
        )

    def _limits(self) -> Finding:
        seen = np.isfinite(self.limits)
        modes = np.flatnonzero(seen.any(axis=1))
        worst = np.where(seen, self.limits, 0.0).max(axis=1)[modes]
        low, high = int(np.argmin(worst)), int(np.argmax(worst))
        return note(
            "not_periodic",
            p=self.p_value,
            least=worst[low],
            most=worst[high],
            low=modes[low] + 1,
            high=modes[high] + 1,
            power=self.power,
        )


def periodicity(
    model: PeriodicModel,
    *,
    harmonics: Sequence[int] = HARMONICS,
    level: float = LEVEL,
    power: float = POWER,
    lifted: Lifted | None = None,
) -> Periodicity:
    r"""Test whether a system is periodic at all.

    .. math:: W = b^T \Sigma^{-1} b \sim \chi^2, \qquad
              \Sigma = \mathrm{diag}_{c,h}(N_{c,h}) + S C S^T

    with b the real and imaginary parts of the coefficients of the harmonics ±m, m in `harmonics`, of every mode,
    channel and hit: all zero in a constant system seen by sensors that stand still in it. Σ is their joint covariance,
    N that of the noise of each row, C that of exponents and fundamental, S the slopes (decision 0014). It is a Wald
    test (Wald 1943), the inverse by Woodbury's identity, so that no matrix is larger than the exponents make it. The
    harmonics are given beforehand: those that selection kept are the largest ones of noise, too.

    Of a real multiplier at κ/2 fundamentals, harmonic m and -κ - m are one another's conjugates. That it is real is not
    counted: a constant mode whose frequency is exactly there looks the same. Neither is a harmonic that lies on a mode
    or its conjugate, as the first of a mode at half the fundamental does.

    Two modes of a constant system that are a whole number of fundamentals apart look like one periodic mode. With
    `lifted`, what was taken for harmonics is looked at: whether it is where harmonics are, as exactly as the responses
    tell.

    Returns the probability, the same for each harmonic, mode and channel, and how small a harmonic would have been
    seen. Raises InputError where the model has no estimates of harmonics that were not selected, or a number is not
    possible.

    Parameters
    ----------
    model
        The model, with the estimates of all its harmonics (`unselected`).
    harmonics
        The harmonics per period that are tested, on both sides of the zeroth.
    level
        The probability at which chance may pass for periodicity.
    power
        The probability with which what lies above the detection limits is to be seen.
    lifted
        The responses, to see whether harmonics are modes of their own; None does not look.
    """
    orders = _orders(harmonics)
    for name, value in (("level", level), ("power", power)):
        if not 0.0 < finite(value, name, "periodicity") < 1.0:
            raise input_error(name, "periodicity", "lie between 0 and 1", f"is {value:g}")
    whole = model.unselected
    if whole is None:
        must = "have the estimates of harmonics that were not selected, too (`unselected`)"
        remedy = "Identify with `constrained=True` and an identifier that gives deviations, and not from a file."
        raise input_error("model", "periodicity", must, "has none", remedy)
    asked = np.isin(np.abs(whole.harmonics), orders)
    tested = np.flatnonzero(asked & ~on_a_mode(whole))
    every = np.arange(whole.blocks.shape[0])
    statistic, degrees, p_value = wald(whole, tested, every)
    sides = np.abs(whole.harmonics[tested])
    parts = (
        [wald(whole, tested[sides == m], every) for m in orders],
        [wald(whole, tested[whole.modes[tested] == r], every) for r in range(len(whole.exponents))],
        [wald(whole, tested, every[[c]]) for c in every],
    )
    adjusted = np.split(holm(np.array([p for part in parts for *_, p in part])), np.cumsum([len(p) for p in parts])[:2])
    tables = [_table(part, probabilities) for part, probabilities in zip(parts, adjusted, strict=True)]
    sizes, limits = _sizes_and_limits(whole, orders, tested, noncentrality(degrees, level, power))
    return Periodicity(
        statistic=statistic,
        degrees=degrees,
        p_value=p_value,
        level=float(level),
        power=float(power),
        harmonics=orders,
        exponents=whole.exponents,
        channels=tuple(channel.name for channel in model.channels),
        by_harmonic=tables[0],
        by_mode=tables[1],
        by_channel=tables[2],
        sizes=sizes,
        limits=limits,
        untested=_untested(whole, orders, tested),
        locked=_locked(whole),
        spacing_p=None if lifted is None else spacing_probability(whole, lifted, _clear(whole, tested)),
    )


def _orders(harmonics: Sequence[int]) -> Integers:
    given = np.atleast_1d(np.asarray(harmonics))
    whole = given.ndim == 1 and given.size and np.issubdtype(given.dtype, np.integer)
    if not whole or given.min() < 1 or len(np.unique(given)) < len(given):
        must = "be different whole numbers from 1 on"
        raise wrong_value("harmonics", "periodicity", must, harmonics, "Pass e.g. (1, 2).")
    return np.sort(given).astype(np.int64)


def on_a_mode(whole: Estimates) -> Mask:
    """Mask of terms of estimates `whole` that lie on another mode's zeroth harmonic, or on its conjugate (terms,)."""
    zeroth = np.flatnonzero(whole.harmonics == 0)
    places = np.concatenate([whole.rates[zeroth], whole.rates[zeroth].conj()])
    gaps = np.abs(np.subtract.outer(whole.rates, places))
    decays = np.abs(whole.rates.real)[:, None] + np.abs(places.real)
    return (gaps < NEAR * decays).any(axis=1) & (whole.harmonics != 0)


def _table(part: list[tuple[float, int, float]], adjusted: Floats) -> PartialTests:
    statistics, degrees, p_values = zip(*part, strict=True)
    return PartialTests(
        statistics=np.array(statistics),
        degrees=np.array(degrees, np.int64),
        p_values=np.array(p_values),
        adjusted=adjusted,
    )


def _clear(whole: Estimates, tested: Indices) -> Indices:
    """Harmonics that clearly rise above the noise, each alone."""
    every = np.arange(whole.blocks.shape[0])
    clear = [k for k in tested if whole.turning[k] and wald(whole, np.array([k]), every)[2] < SURE]
    return np.array(clear, np.intp)


def _sizes_and_limits(whole: Estimates, orders: Integers, tested: Indices, least: float) -> tuple[Floats, Floats]:
    r"""Size of each harmonic, and its detection limit, over the zeroth of its mode.

    The shape that is seen least has the largest variance, at most the sum of the largest of noise and of exponents:

    .. math:: b^T \Sigma^{-1} b \ge |b|^2 / (\lambda_{\max}(N) + \lambda_{\max}(S C S^T))
    """
    sizes, limits = np.full((2, len(whole.exponents), len(orders)), np.nan)
    std, factor = whole.std(), covariance_root(whole.covariance)
    for mode, k in np.ndindex(sizes.shape):
        zeroth = whole.term(mode, 0)
        terms = tested[(whole.modes[tested] == mode) & (np.abs(whole.harmonics[tested]) == orders[k])]
        if zeroth is None or not len(terms):
            continue
        unit = np.abs(whole.scales[zeroth])
        reference = float(np.sum(np.abs(whole.coefficients[zeroth] / unit) ** 2))
        squares = float(np.sum(np.abs(whole.coefficients[terms] / unit) ** 2 - np.abs(std[terms] / unit) ** 2))
        sizes[mode, k] = np.sqrt(max(squares, 0.0) / reference)
        stretch = np.abs(whole.scales[terms] / unit).max(axis=(1, 2))
        both = np.concatenate([terms, terms + len(whole.modes)])
        spread = whole.spread[:, both][:, :, both] * np.outer(np.tile(stretch, 2), np.tile(stretch, 2))
        moved = (whole.slopes[terms] / unit[:, :, None]).reshape(-1, len(factor)) @ factor
        variance = np.linalg.eigvalsh(spread).max() + np.linalg.eigvalsh((moved.conj().T @ moved).real).max(initial=0.0)
        limits[mode, k] = np.sqrt(least * variance / reference)
    return sizes, limits


def _untested(whole: Estimates, orders: Integers, tested: Indices) -> Integers:
    """Mode and harmonic of what is asked for and not tested; of a real multiplier one of two conjugates is."""
    done = set(zip(whole.modes[tested].tolist(), whole.harmonics[tested].tolist(), strict=True))
    missing = [
        (mode, m)
        for mode, turns in enumerate(whole.half_turns)
        for m in np.concatenate([-orders[::-1], orders]).tolist()
        if (mode, m) not in done and not (whole.real[mode] and 2 * m + turns < 0)
    ]
    return np.array(missing, np.int64).reshape(-1, 2)


def _locked(whole: Estimates) -> Integers:
    """Modes of real multipliers that share their half turns, not zero, with another."""
    turns = whole.half_turns
    return np.flatnonzero((turns != 0) & ((turns[:, None] == turns).sum(axis=1) > 1)).astype(np.int64)
