"""Records that are not what they seem, each with what floquid has to say of it.

`RECORDS` is a table. Each row makes a record, or several hits, of a system that is known, does to it what goes wrong in
practice, and says what must come of it:

    modes      the right exponents, within their stated deviations, and a verdict that is passed
    doubted    a result that is not passed, or that comes with a warning of the words given
    refused    no result, and the words given
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import floquid as fq
from floquid.testing import pair_exponents

PERIOD = 2.0
DECAYING = (-0.03 + 0.7j, -0.05 + 1.9j)
NOISE = 0.01
MOST = 5.0
"""Deviations that the worst of a few exponents may be off by."""

Records = fq.Record | list[fq.Record]
Answer = Literal["modes", "doubted", "refused"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Bad:
    """A row: what is wrong with the record, how it is made, and what must come of it."""

    name: str
    make: Callable[[], Records]
    answer: Answer
    words: str = ""
    truth: tuple[complex, ...] = DECAYING
    settings: dict[str, Any] = field(default_factory=dict)
    slow: bool = False


def response(
    samples: float = 12,
    *,
    exponents: tuple[complex, ...] = DECAYING,
    noise: float = NOISE,
    periods: float = 40,
    channels: int = 2,
    seed: int = 0,
) -> NDArray[np.float64]:
    """The free response of the exponents, each with three harmonics, and white noise (channels, samples)."""
    times = np.arange(int(periods * samples)) * PERIOD / samples
    shapes = np.random.default_rng(3)
    values = np.zeros((channels, len(times)))
    for exponent in exponents:
        for harmonic, size in ((0, 1.0), (1, 0.5), (-1, 0.4)):
            parts = size * shapes.standard_normal((2, channels, 1))
            rate = exponent + 2j * np.pi * harmonic / PERIOD
            values += 2.0 * np.real((parts[0] + 1j * parts[1]) * np.exp(rate * times))
    largest = np.abs(values).max(axis=1, keepdims=True)
    return values + noise * largest * np.random.default_rng([seed, 1]).standard_normal(values.shape)


def record(values: Any, samples: float = 12, *, period: float = PERIOD, start: float = 0.0) -> fq.Record:
    """A record of so many samples a period."""
    values = np.atleast_2d(values)
    names = [*"XYZUVW"][: len(values)]
    clock = fq.ConstantPeriod(period=period)
    return fq.Record(values=values, sample_rate=samples / period, channels=names, clock=clock, start=start)


def made(change: Callable[[NDArray[np.float64]], Any] = lambda v: v, samples: float = 12, **how: Any) -> Callable:
    """What makes a record of a response that is changed."""
    return lambda: record(change(response(samples, **how)), samples)


def beside(*rows: tuple[float, float]) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Adds channels that are sums of the first two."""
    return lambda v: np.concatenate([v, np.array(rows) @ v[:2]])


def put(value: float, row: int = 1, first: int = 0, end: int | None = None) -> Callable:
    """Puts one value in place of samples of a channel."""

    def change(values: NDArray[np.float64]) -> NDArray[np.float64]:
        values[row, first:end] = value
        return values

    return change


def counts(full: float, kind: type = np.int16, *, clip: bool = True) -> Callable:
    """Integers, the largest value being `full`; what an integer cannot hold is clipped, or wraps round."""

    def change(values: NDArray[np.float64]) -> NDArray[Any]:
        whole = np.round(values / np.abs(values).max() * full)
        limits = np.iinfo(kind)
        return (np.clip(whole, limits.min, limits.max) if clip else whole.astype(np.int64)).astype(kind)

    return change


def times(samples: float = 12, periods: float = 40) -> NDArray[np.float64]:
    """The times of the samples (samples,) [s]."""
    return np.arange(int(periods * samples)) * PERIOD / samples


def noise(kind: str, channels: int, samples: float = 12, *, seed: int = 0) -> Callable[[], fq.Record]:
    """Noise and nothing else: white, red (an autoregression), peaked (a narrow one), or a random walk."""

    def make() -> fq.Record:
        from scipy.signal import lfilter

        white = np.random.default_rng([seed, channels]).standard_normal((channels, int(60 * samples) + 500))
        poles = {"white": [1.0], "red": [1.0, -0.95], "peaked": [1.0, -1.9, 0.98], "walk": [1.0, -1.0]}[kind]
        return record(lfilter([1.0], poles, white, axis=1)[:, 500:], samples)

    return make


def alone(values: Callable[[NDArray[np.float64]], NDArray[np.float64]], level: float = NOISE, samples: float = 12):
    """What makes a record of a function of time, in two channels, and noise."""

    def make() -> fq.Record:
        t = times(samples)
        both = np.array([[1.0], [0.7]]) * values(t)
        return record(both + level * np.random.default_rng(8).standard_normal(both.shape), samples)

    return make


def hits(change: Callable[[NDArray[np.float64]], NDArray[np.float64]], *, seed: int = 0) -> Callable[[], list]:
    """Two hits, the second being changed, with noise of its own where the seed differs."""
    return lambda: [record(response()), record(change(response(seed=seed)))]


def _channels(samples: float) -> Iterator[Bad]:
    way = "" if samples == 12 else ", as sampled"
    yield Bad(name=f"nothing is wrong{way}", make=made(samples=samples), answer="modes")
    yield Bad(name=f"no noise{way}", make=made(samples=samples, noise=0.0), answer="modes")
    yield Bad(name=f"a channel twice{way}", make=made(beside((1, 0)), samples), answer="refused", words="is a copy of")
    yield Bad(
        name=f"a channel again in other units{way}",
        make=made(beside((-2.54, 0)), samples),
        answer="doubted",
        words="it is -2.54 times channel 'X', noise included, and tells nothing more",
    )
    yield Bad(
        name=f"two sensors side by side{way}",
        make=lambda: record(np.concatenate([response(samples), response(samples, seed=9)[:1]]), samples),
        answer="modes",
    )
    yield Bad(
        name=f"channels 1e9 and 1e-9 times the others{way}",
        make=made(lambda v: v * np.array([[1e9], [1e-9]]), samples),
        answer="modes",
    )
    for what, value, words in (
        ("of a constant", 3.0, "is constant (3)"),
        ("of zeros", 0.0, "is constant (0)"),
        ("without any sample", np.nan, "has none"),
        ("of 1e200", 1e200, "reaches 1e+200"),
        ("of subnormal numbers", 1e-310, "reaches 1e-310"),
    ):
        yield Bad(name=f"a channel {what}{way}", make=made(put(value), samples), answer="refused", words=words)


def _samples(samples: float) -> Iterator[Bad]:
    way = "" if samples == 12 else ", as sampled"
    yield Bad(name=f"all zeros{way}", make=made(lambda v: 0.0 * v, samples), answer="refused", words="is constant (0)")
    yield Bad(name=f"single precision{way}", make=made(np.float32, samples, noise=0.0), answer="modes")
    yield Bad(name=f"integers of 16 bits{way}", make=made(counts(20000), samples), answer="modes")
    yield Bad(
        name=f"integers that wrapped round{way}",
        make=made(counts(50000, clip=False), samples),
        answer="refused",
        words="wraps round: it jumps by 65536 counts",
    )
    yield Bad(
        name=f"a growing mode{way}",
        make=made(samples=samples, exponents=(0.03 + 0.7j,)),
        answer="modes",
        words="grow",
        truth=(0.03 + 0.7j,),
    )
    yield Bad(
        name=f"a growing mode with a gap{way}",
        make=made(put(np.nan, first=50, end=70), samples, exponents=(0.03 + 0.7j,)),
        answer="modes",
        words="grow",
        truth=(0.03 + 0.7j,),
    )
    yield Bad(
        name=f"growth beyond 1e200{way}",
        make=made(samples=samples, exponents=(6.0 + 0.7j,)),
        answer="refused",
        words="whose squares can be computed with",
    )
    yield Bad(
        name=f"an undamped mode{way}", make=made(samples=samples, exponents=(0.7j,)), answer="modes", truth=(0.7j,)
    )
    yield Bad(
        name=f"a record that begins at 1e12 s{way}",
        make=lambda: record(response(samples), samples, start=1e12),
        answer="modes",
    )
    yield Bad(
        name=f"a record played backwards{way}",
        make=made(lambda v: v[:, ::-1], samples),
        answer="modes",
        words="grow",
        truth=tuple(-value.conjugate() for value in DECAYING),
    )
    yield Bad(name=f"white noise{way}", make=noise("white", 4, samples), answer="refused", words="no mode rises above")
    yield Bad(
        name=f"an orbit and no free response{way}",
        make=alone(
            lambda t: np.cos(2.0 * np.pi * t / PERIOD) + 0.3 * np.cos(4.0 * np.pi * t / PERIOD), samples=samples
        ),
        answer="refused",
        words="no mode rises above",
    )
    yield Bad(name=f"a ramp{way}", make=alone(lambda t: t, samples=samples), answer="refused", words="no mode rises")


LIFTED = [
    Bad(
        name="the sum of two channels",
        make=made(beside((1, 1))),
        answer="doubted",
        words="'Z' was left out: it is 1 times channel 'X' and 1 times channel 'Y'",
    ),
    Bad(
        name="two channels turned by 30°",
        make=made(beside((0.75**0.5, 0.5), (-0.5, 0.75**0.5))),
        answer="doubted",
        words="0.866 times channel 'X' and 0.5 times channel 'Y'",
    ),
    Bad(name="an offset of 1e6", make=made(lambda v: v + 1e6), answer="modes"),
    Bad(name="one sample is missing", make=made(put(np.nan, first=100, end=101)), answer="modes"),
    Bad(name="half of a channel is missing", make=made(put(np.nan, first=240)), answer="modes"),
    Bad(name="one channel", make=made(lambda v: v[:1]), answer="modes"),
    Bad(name="a channel of the wrong sign", make=made(lambda v: v * np.array([[1.0], [-1.0]])), answer="modes"),
    Bad(name="integers of 32 bits", make=made(counts(2e9, np.int32)), answer="modes"),
    Bad(name="integers of 8 bits", make=made(counts(127, np.int8)), answer="modes"),
    Bad(
        name="counts that saturated", make=made(counts(60000)), answer="doubted", words="is clipped at -32768 and 32767"
    ),
    Bad(
        name="a forced response of two periods",
        make=alone(lambda t: np.cos(np.pi * t / PERIOD)),
        answer="refused",
        words="no decay was seen on it",
    ),
    Bad(
        name="growth by e^60",
        make=made(exponents=(0.75 + 0.7j,), noise=0.0),
        answer="modes",
        words="grow",
        truth=(0.75 + 0.7j,),
    ),
    Bad(name="a constant", make=alone(np.ones_like, 0.0), answer="refused", words="is constant (1)"),
    Bad(name="a constant and noise", make=alone(np.ones_like), answer="refused", words="no mode rises above"),
    Bad(name="one impulse", make=alone(lambda t: 1.0 * (t == t[5])), answer="refused", words="no mode rises above"),
    Bad(
        name="a step",
        make=alone(lambda t: 1.0 * (t > 30.0)),
        answer="refused",
        words="the noise cannot be told from the response",
        slow=True,
    ),
    Bad(name="white noise in one channel", make=noise("white", 1), answer="refused", words="no mode rises above"),
    Bad(name="red noise", make=noise("red", 1), answer="refused", words="no mode rises above"),
    Bad(name="noise with a peak", make=noise("peaked", 1, 16, seed=6), answer="refused", words="no mode rises above"),
    Bad(name="a random walk", make=noise("walk", 1, 16, seed=2), answer="refused", words="no mode rises above"),
    Bad(name="one sample", make=made(lambda v: v[:, :1]), answer="refused", words="shorter than the record"),
    Bad(name="two samples", make=made(lambda v: v[:, :2]), answer="refused", words="shorter than the record"),
    Bad(name="three periods", make=made(periods=3), answer="refused", words="fewer than 4"),
    Bad(
        name="a period longer than the record",
        make=lambda: record(response(), 1000, period=1000 * PERIOD / 12),
        answer="refused",
        words="shorter than the record",
    ),
    Bad(
        name="a period of half a sample",
        make=lambda: record(response(), 0.5),
        answer="refused",
        words="two sampling intervals or more",
    ),
    Bad(
        name="one sample a period",
        make=lambda: record(response(1, exponents=DECAYING[:1], periods=100), 1),
        answer="modes",
        truth=DECAYING[:1],
    ),
    Bad(
        name="more poles than periods",
        make=made(),
        settings={"order": 100},
        answer="refused",
        words="less than the 40 periods",
    ),
    Bad(
        name="more poles than modes",
        make=made(),
        settings={"order": 10},
        answer="doubted",
        words="power that a fit finds in noise alone",
    ),
    Bad(name="fewer poles than modes", make=made(), settings={"order": 2}, answer="doubted", words="is too low"),
    Bad(
        name="one hit given twice", make=hits(lambda v: v), answer="refused", words="channel 'X' of record 2 is a copy"
    ),
    Bad(
        name="one hit given twice, in other units",
        make=hits(lambda v: 3.0 * v),
        answer="refused",
        words="channel 'X' of record 2 equals 3 times channel 'X' of record 1",
    ),
    Bad(name="two hits", make=hits(lambda v: 3.0 * v, seed=4), answer="modes"),
]

SAMPLED = [
    Bad(
        name="growth by e^60, as sampled",
        make=made(samples=12.1, exponents=(0.75 + 0.7j,), noise=0.0),
        answer="modes",
        words="grow",
        truth=(0.75 + 0.7j,),
    ),
    Bad(
        name="a decay by a factor of 20 in a period, as sampled",
        make=made(samples=12.1, exponents=(-1.5 + 0.7j,)),
        answer="refused",
        words="no mode rises above",
    ),
    Bad(
        name="red noise, as sampled",
        make=noise("red", 1, 12.1),
        answer="refused",
        words="no mode rises above",
        slow=True,
    ),
    Bad(
        name="a random walk, as sampled",
        make=noise("walk", 4, 12.1),
        answer="refused",
        words="no mode rises above",
        slow=True,
    ),
    Bad(
        name="a million samples, of which the first few hundred are a response",
        make=made(exponents=(-0.25 + 0.7j,), samples=20, periods=50_000),
        answer="modes",
        truth=(-0.25 + 0.7j,),
        slow=True,
    ),
    Bad(
        name="a million samples, of which the first few hundred are a response, as sampled",
        make=made(exponents=(-0.25 + 0.7j,), samples=20.1, periods=50_000),
        answer="modes",
        truth=(-0.25 + 0.7j,),
        slow=True,
    ),
]

RECORDS = [*_channels(12), *_samples(12), *LIFTED, *_channels(12.1), *_samples(12.1), *SAMPLED]
"""The table. Twelve samples a period are lifted; 12.1 are fitted as they were sampled."""


def told(bad: Bad) -> tuple[Answer, str, float | None]:
    """What floquid says of the record of a row: the answer, its words, and the worst error in deviations."""
    try:
        analysis = fq.identify(bad.make(), **bad.settings)
    except fq.errors.FloquidError as error:
        return "refused", str(error), None
    verdict = analysis.validation
    words = " ".join([*analysis.warnings, *verdict.reasons])
    if bad.answer != "modes":
        return ("doubted" if words else "modes"), words, None
    if not verdict.passed or analysis.model.order != 2 * len(bad.truth):
        return "doubted", words or f"order {analysis.model.order}", None
    return "modes", words, worst(analysis.model, bad.truth)


def worst(model: fq.PeriodicModel, truth: tuple[complex, ...]) -> float:
    """The largest error of the real and the imaginary parts of the exponents, in deviations."""
    both = np.array([each for value in truth for each in (value, value.conjugate())])
    pairs = pair_exponents(model.exponents, both, model.period)
    std = model.exponent_std[pairs.permutation]
    return float(np.abs([pairs.differences.real / std.real, pairs.differences.imag / std.imag]).max())
