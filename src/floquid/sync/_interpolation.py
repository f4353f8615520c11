"""Band-limited interpolation of uniform samples at arbitrary instants.

`scipy.signal.resample_poly` and libsoxr give equally spaced instants only and resampy's table reaches neither arbitrary
accuracy nor NaN, so the kernel is our own: a sinc under a Kaiser window, its taps polynomials in the fractional delay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from floquid._arrays import BLOCK, Floats, Indices
from floquid._checks import finite, frozen_array, input_error, positive

BAND = 0.8  # end of the pass band, as a share of the cut-off frequency, by default
ACCURACY = 1e-6  # the error of interpolation, as a share of each line's amplitude, unless told

_MARGIN = 8.0
# Ripple of the pass band, images and the ripple that the unit gain at zero moves add up to 5.2 times the ripple that
# Kaiser's formulas are asked for, at most, over accuracies of 1e-2 to 1e-9, bands of 0.5 to 0.98 and all cut-offs. At
# 1e-10 the formulas themselves fall short.
_DEGREE = 20
# Over one sampling interval a tap turns by less than 3 rad: Chebyshev coefficients fall below 1e-16 by here.


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Kernel:
    """Weights of the samples about an instant, by its fractional delay."""

    coefficients: Floats  # Chebyshev coefficients (degree + 1, taps) of each tap over delays of 0 to 1 sample
    half_width: int  # samples used on either side of the instant: taps are twice as many

    def weights(self, delays: Floats) -> Floats:
        """The weights (delays, taps) at `delays` [samples] in [0, 1] past the last sample before the instant."""
        return np.polynomial.chebyshev.chebvander(2.0 * delays - 1.0, len(self.coefficients) - 1) @ self.coefficients

    @property
    def offsets(self) -> Indices:
        """Position of each tap (taps,) [samples] from the last sample before the instant."""
        return np.arange(1 - self.half_width, self.half_width + 1)


def design(sample_rate: float, cutoff: float, band: float, accuracy: float, of: str) -> Kernel:
    """The kernel of `interpolate`; `of` is the callable that messages name."""
    from scipy.special import i0

    rate = positive(sample_rate, "sample_rate", of, unit="Hz")
    share = positive(cutoff, "cutoff", of, unit="Hz") / rate
    check_options(band, accuracy, of)
    if not 1e-4 <= share <= 0.5 * (1.0 + 1e-12):
        must = f"lie between 1e-4 of the sampling rate and half of it ({0.5 * rate:.6g} Hz)"
        raise input_error("cutoff", of, must, f"is {cutoff:.6g} Hz", "Pass half the lower of the old rate and the new.")
    n_taps, beta = _kaiser(20.0 * np.log10(_MARGIN / accuracy), 4.0 * (1.0 - band) * share)
    half = int(np.ceil(0.5 * (n_taps - 1)))

    chebyshev = np.polynomial.chebyshev
    nodes = chebyshev.chebpts1(_DEGREE + 1)
    apart = 0.5 * (nodes[:, None] + 1.0) - np.arange(1 - half, half + 1)
    window = i0(beta * np.sqrt(np.maximum(1.0 - (apart / half) ** 2, 0.0)))
    taps = np.sinc(2.0 * share * apart) * window
    # Gain one at zero for every delay: a large offset leaves nothing at the differences of the two rates.
    taps /= taps.sum(axis=1, keepdims=True)
    return Kernel(coefficients=np.linalg.solve(chebyshev.chebvander(nodes, _DEGREE), taps), half_width=half)


def _kaiser(attenuation: float, width: float) -> tuple[int, float]:
    """Taps and β of Kaiser's window above 50 dB, as `scipy.signal.kaiserord`, which takes a second to load."""
    return int(np.ceil((attenuation - 7.95) / 2.285 / (np.pi * width) + 1.0)), 0.1102 * (attenuation - 8.7)


def check_options(band: float, accuracy: float, of: str) -> None:
    """Refuse a band or an accuracy for which the error bound has not been measured."""
    if not 0.5 <= finite(band, "band", of) <= 0.98:
        raise input_error("band", of, "lie in [0.5, 0.98]", f"is {band:g}", "It is a share of the cut-off frequency.")
    if not 1e-9 <= finite(accuracy, "accuracy", of) <= 1e-2:
        raise input_error("accuracy", of, "lie in [1e-9, 1e-2]", f"is {accuracy:g}")


def half_width(sample_rate: float, *, cutoff: float, band: float = BAND, accuracy: float = ACCURACY) -> int:
    r"""Samples that `interpolate` needs on either side of an instant.

    .. math:: h = \left\lceil \frac{A - 7.95}{2 \cdot 2.285\,\Delta\omega} \right\rceil, \qquad
        A = -20\log_{10}\frac{\text{accuracy}}{8}, \quad \Delta\omega = \frac{4\pi(1 - \text{band})f_c}{f_s}

    (Kaiser 1974, as in Oppenheim and Schafer, Discrete-Time Signal Processing, section 7.5.3; the 8 is what makes the
    sum of ripple and images stay below the accuracy.) `sample_rate` is f_s [Hz]; `cutoff`, `band` and `accuracy` are
    those of `interpolate`.

    Raises InputError where a parameter is not possible.
    """
    return design(sample_rate, cutoff, band, accuracy, "half_width").half_width


def interpolation_error(
    frequencies: ArrayLike,
    sample_rate: float,
    *,
    cutoff: float,
    band: float = BAND,
    accuracy: float = ACCURACY,
    growth: float = 0.0,
) -> Floats:
    r"""The largest error of `interpolate` over the fractional delay, of a response of unit amplitude (frequencies,).

    .. math:: \max_{0 \le d \le 1} \Bigl| \sum_n h(d - n)\, e^{(\sigma + 2\pi i f)(n - d)/f_s} - 1 \Bigr|

    Below band·cutoff it is at most the accuracy times :math:`e^{4|\sigma|h}`, h being the half-width [s].

    At the `frequencies` f (frequencies,) [Hz], for a response that grows at the rate σ = `growth` [1/s], or decays
    where it is negative; `sample_rate`, `cutoff`, `band` and `accuracy` are those of `interpolate`. Raises InputError
    where a parameter is not possible.
    """
    of = "interpolation_error"
    lines = frozen_array(frequencies, "frequencies", of, axes=("frequencies",))
    kernel = design(sample_rate, cutoff, band, accuracy, of)
    rates = (finite(growth, "growth", of, unit="1/s") + 2j * np.pi * lines) / sample_rate
    delays = np.linspace(0.0, 1.0, 33)
    seen = kernel.weights(delays)[None] * np.exp(rates[:, None, None] * (kernel.offsets - delays[:, None]))
    return np.abs(seen.sum(axis=2) - 1.0).max(axis=1)


def interpolate(
    values: ArrayLike,
    sample_rate: float,
    start: float,
    times: ArrayLike,
    *,
    cutoff: float,
    band: float = BAND,
    accuracy: float = ACCURACY,
) -> Floats:
    r"""Band-limited interpolation at any instants, by a sinc under a Kaiser window.

    .. math:: \hat y(t) = \sum_{|t - t_n| < h} \frac{2 f_c}{f_s}\operatorname{sinc}\bigl(2 f_c (t - t_n)\bigr)
        \frac{I_0\bigl(\beta\sqrt{1 - (t - t_n)^2/h^2}\bigr)}{I_0(\beta)}\; y(t_n)

    (Smith, Digital Audio Resampling, CCRMA; window of Kaiser 1974), brought to a gain of one at zero frequency. For
    :math:`y = \sum_k a_k e^{\sigma_k t}\cos(2\pi f_k t + \phi_k)` with all :math:`|f_k|` up to band·cutoff,

    .. math:: |\hat y(t) - y(t)| \le \text{accuracy} \cdot \sum_k |a_k|\, e^{\sigma_k t}\, e^{4|\sigma_k| h}

    and what lies beyond (2 - band)·cutoff is stopped to the accuracy. White noise of variance v comes out with a
    variance of about 2·cutoff/sample_rate·v.

    Returns the channels at the instants (channels, times): NaN where the samples of `half_width` on either side are not
    all in the record, and, channel by channel, where one of them is missing. Raises InputError where a parameter is not
    possible.

    Parameters
    ----------
    values
        Samples (channels, samples); NaN marks a missing one.
    sample_rate, start
        Samples a second f_s [Hz], and the time of the first sample [s].
    times
        The instants (times,) [s], in any order.
    cutoff
        Half the lower of the old rate and the new f_c [Hz].
    band, accuracy
        The pass band as a share of the cut-off (a narrower one needs fewer samples about each instant), and the error
        as a share of each line's amplitude.
    """
    of = "interpolate"
    array = frozen_array(values, "values", of, axes=("channels", "samples"), missing=True)
    instants = frozen_array(times, "times", of, axes=("times",))
    kernel = design(sample_rate, cutoff, band, accuracy, of)
    position = (instants - finite(start, "start", of, unit="s")) * sample_rate
    before = np.floor(position)
    inside = (before >= kernel.half_width - 1) & (before < array.shape[1] - kernel.half_width)
    # In order of time, so that a block of instants needs a short stretch of the record.
    order = np.flatnonzero(inside)
    order = order[np.argsort(position[order], kind="stable")]
    result = np.full((len(array), len(instants)), np.nan)
    block = max(1, BLOCK // (2 * kernel.half_width))
    for low in range(0, len(order), block):
        chosen = order[low : low + block]
        result[:, chosen] = _weighted(array, kernel, before[chosen].astype(np.intp), (position - before)[chosen])
    return result


def _weighted(values: Floats, kernel: Kernel, before: Indices, delays: Floats) -> Floats:
    """The channels (channels, times) at ascending instants: a product with a sparse matrix, which hands NaN on."""
    from scipy.sparse import csr_array

    n_taps = 2 * kernel.half_width
    first = before[0] + 1 - kernel.half_width
    stretch = values[:, first : before[-1] + 1 + kernel.half_width]
    columns = (before - first)[:, None] + kernel.offsets
    rows = np.arange(0, columns.size + 1, n_taps)
    matrix = csr_array((kernel.weights(delays).ravel(), columns.ravel(), rows), shape=(len(before), stretch.shape[1]))
    return (matrix @ stretch.T).T
