"""Draws that are done, on the disk; the spread of a quantity over them, against its asymptotic deviation."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from floquid._arrays import Floats, Mask
from floquid._checks import Rebuilt, input_error, wrong_value
from floquid.fit import HALF_DIGITS
from floquid.io import atomic_path
from floquid.pipeline.draws._redraw import Draw

MATERIAL = 0.25  # the bias, over the deviation, below which it does not matter: the root-mean-square error grows by 3 %


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spread(Rebuilt):
    r"""One quantity over the draws of a bootstrap.

    .. math:: s^2 = \frac{1}{B - 1} \sum_b (\theta_b - \bar\theta)^2, \qquad
              \frac{\mathrm{std}(s)}{s} \approx \frac{1}{\sqrt{2 (B - 1)}}

    (Efron and Tibshirani 1993, "An Introduction to the Bootstrap", chapters 6 and 13.) Of a complex quantity everything
    is said of the real part and of the imaginary part: a deviation, an end of an interval or a ratio has the real
    part's as its real part. Its imaginary part is that of the imaginary part.

    Parameters
    ----------
    name
        What it is.
    unit
        Its unit.
    estimate
        What the draws were made from (...).
    draws
        What each draw gave (draws, ...).
    asymptotic
        The deviations that the fit gave (...); None where it gave none.
    distinct
        Which elements are not the mirror image of another, as those of a conjugate mode are (...).
    bound
        Whether `asymptotic` counts more than noise, so that draws may spread less, but not more: then their distance
        from `estimate` is compared with it, √(s² + bias²), and not s.
    """

    name: str
    unit: str
    estimate: NDArray
    draws: NDArray
    asymptotic: NDArray | None
    distinct: Mask
    bound: bool = False

    def __post_init__(self) -> None:
        kind = np.complex128 if np.iscomplexobj(self.estimate) else np.float64
        shape = np.shape(self.estimate)
        self._freeze(dtype=kind, estimate=shape, draws=("draws", *shape))
        if len(self.draws) < 2:
            raise input_error("draws", "Spread", "hold two draws or more", f"has {len(self.draws)}")
        self._freeze(dtype=kind, asymptotic=shape)
        distinct = np.broadcast_to(np.asarray(self.distinct, bool), shape).copy()
        distinct.flags.writeable = False
        object.__setattr__(self, "distinct", distinct)

    @property
    def std(self) -> NDArray:
        """The deviation of the draws (...)."""
        return _whole(_parts(self.draws).std(axis=0, ddof=1), self.estimate)

    @property
    def sampling_error(self) -> float:
        """The relative deviation of `std` itself, 1/√(2 (draws - 1)), as of normal draws."""
        return float(1.0 / np.sqrt(2.0 * (len(self.draws) - 1)))

    @property
    def bias(self) -> NDArray:
        """The mean of the draws less what they were made from (...)."""
        return self.draws.mean(axis=0) - self.estimate

    @property
    def ratio(self) -> NDArray | None:
        """The deviation of the draws over the asymptotic one (...), NaN where that is zero; None without any.

        Of a bound, their root-mean-square distance from `estimate` over it.
        """
        if self.asymptotic is None:
            return None
        below = _parts(self.asymptotic)
        ratio = np.full(below.shape, np.nan)
        return _whole(np.divide(self._size(), below, out=ratio, where=self._tested()), self.estimate)

    def interval(self, level: float = 0.95) -> tuple[NDArray, NDArray]:
        """The percentile interval: both ends (...) of what holds the share `level` of the draws, as much beyond each.

        `level` is the share, between 0 and 1. Raises InputError where `level` is not between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise wrong_value("level", "Spread.interval", "lie between 0 and 1", level, "Pass e.g. 0.95.")
        low, high = np.quantile(_parts(self.draws), [0.5 - 0.5 * level, 0.5 + 0.5 * level], axis=0)
        return _whole(low, self.estimate), _whole(high, self.estimate)

    def ratios(self) -> Floats:
        """The ratios that mean something, each once (ratios,); none where there are no asymptotic deviations."""
        if self.asymptotic is None:
            return np.zeros(0)
        return self._size()[self._tested()] / _parts(self.asymptotic)[self._tested()]

    def chances(self) -> Floats:
        r"""Probability that chance takes a ratio at least as far from one (ratios,), in the order of `ratios`.

        Twice the smaller tail of (B - 1) s²/σ² against the chi-square distribution of B - 1 degrees of freedom; of a
        bound, the upper tail of B (s² + bias²)/σ² against that of B.
        """
        from scipy.special import chdtr, chdtrc

        if self.bound:
            return chdtrc(len(self.draws), len(self.draws) * self.ratios() ** 2)
        degrees = len(self.draws) - 1
        score = degrees * self.ratios() ** 2
        return np.minimum(2.0 * np.minimum(chdtr(degrees, score), chdtrc(degrees, score)), 1.0)

    def spare(self) -> Floats:
        """Probability that chance takes a ratio at least as far below one, were the deviation no bound (ratios,)."""
        from scipy.special import chdtr

        return chdtr(len(self.draws), len(self.draws) * self.ratios() ** 2)

    def biases(self) -> Floats:
        """The bias of each distinct element that varies over its deviation (biases,)."""
        std, bias = _parts(self.std), _parts(self.bias)
        kept = _parts_of(self.distinct, self.estimate) & (std > HALF_DIGITS * std.max(initial=0.0))
        return bias[kept] / std[kept]

    def _size(self) -> Floats:
        """Deviation of the draws that is compared with the asymptotic one (..., parts)."""
        if not self.bound:
            return _parts(self.std)
        return np.sqrt(np.mean((_parts(self.draws) - _parts(self.estimate)) ** 2, axis=0))

    def _tested(self) -> Mask:
        """Mask of parts that have a deviation to compare with, and are not listed twice (..., parts)."""
        assert self.asymptotic is not None
        own = _parts(self.asymptotic)
        return _parts_of(self.distinct, self.estimate) & (own > HALF_DIGITS * own.max(initial=0.0))


def _parts(values: NDArray) -> Floats:
    """Real and imaginary part along a last axis; of real values that alone."""
    if np.iscomplexobj(values):
        return np.stack([np.real(values), np.imag(values)], axis=-1)
    return np.asarray(values, np.float64)[..., None]


def _parts_of(mask: Mask, like: NDArray) -> Mask:
    """A mask over elements as one over their parts."""
    return np.repeat(mask[..., None], 2 if np.iscomplexobj(like) else 1, axis=-1)


def _whole(parts: Floats, like: NDArray) -> NDArray:
    """The inverse of `_parts`."""
    return parts[..., 0] + 1j * parts[..., 1] if np.iscomplexobj(like) else parts[..., 0]


EVERY = 5.0  # seconds between two writings

_ARRAYS = ("exponents", "coefficients", "system", "transition", "inputs")


@dataclass(slots=True, kw_only=True)
class DrawFile:
    """Keeps the draws of one bootstrap in a file: an archive of plain arrays, replaced whole.

    Parameters
    ----------
    path
        The file.
    key
        What the draws are of: the result, the seed, what is fitted. Draws under another key are not taken up.
    """

    path: Path
    key: str
    _written: float = field(default_factory=time.monotonic, init=False)

    def read(self) -> list[Draw]:
        """The draws that are done; none where there is no such file, or it is of something else, or damaged."""
        try:
            with self.path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                packed = any(member.compress_type for member in file.zip.infolist())  # not as it was written
                if packed or str(file["key"]) != self.key:
                    return []
                return _draws({name: file[name] for name in file.files})
        except Exception:  # noqa: BLE001  # damage raises anything: zip, zlib, numpy; then there are no draws
            return []

    def keep(self, draws: Sequence[Draw]) -> None:
        """Write the draws, unless they were written a moment ago."""
        if time.monotonic() - self._written >= EVERY:
            self.write(draws)

    def write(self, draws: Sequence[Draw]) -> None:
        """Write all `draws` that are done. Raises InputError where the file cannot be written."""
        used = [one for one in draws if one.exponents is not None]
        content: dict[str, Any] = {
            "key": np.array(self.key),
            "orders": np.array([one.order for one in draws], np.int64),
            "failures": np.array([one.failure for one in draws], np.str_),
            "used": np.array([one.exponents is not None for one in draws], bool),
            "periods": np.array([one.period for one in used]),
        }
        for name in _ARRAYS:
            values = [getattr(one, name) for one in used]
            if values and values[0] is not None:
                content[name] = np.array(values)
        with atomic_path(self.path, of="bootstrap") as temporary, temporary.open("wb") as stream:
            np.savez(stream, **content)
        self._written = time.monotonic()


def _draws(content: dict[str, NDArray[Any]]) -> list[Draw]:
    found, row = [], 0
    for order, failure, used in zip(content["orders"], content["failures"], content["used"], strict=True):
        if not used:
            found.append(Draw(int(order), failure=str(failure)))
            continue
        arrays = {name: content[name][row] for name in _ARRAYS if name in content}
        found.append(Draw(int(order), period=float(content["periods"][row]), **arrays))
        row += 1
    return found
