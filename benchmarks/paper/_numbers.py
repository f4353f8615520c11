"""One number of the paper, and ours beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from floquid.views import with_error


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A number of ours.

    Parameters
    ----------
    value
        From the first draw of the noise.
    std
        Its standard deviation; None where it is not estimated.
    draws
        The same number from every draw; empty where it was not taken.
    """

    value: float
    std: float | None = None
    draws: tuple[float, ...] = ()

    @property
    def mean(self) -> float:
        """The mean over the draws."""
        return float(np.mean(self.draws))

    @property
    def worst(self) -> float:
        """The largest of the draws."""
        return float(np.max(self.draws))


@dataclass(frozen=True, slots=True, kw_only=True)
class Number:
    """One number of section 3 of Allen 2009.

    Parameters
    ----------
    key
        A short name of it, the only one of its kind.
    section
        The section of the paper that states it.
    what
        What it is.
    printed
        As the paper prints it; empty when it does not.
    corrected
        The right value by the rotor's equations, or what is left of an error without any noise; None where there is
        none beside the printed one.
    ami, maximum_likelihood
        Ours; None where there is nothing to identify.
    form
        How its values are written, as for `format`.
    note
        What differs, and why; may be empty.
    """

    key: str
    section: str
    what: str
    printed: str
    corrected: float | None = None
    ami: Estimate | None = None
    maximum_likelihood: Estimate | None = None
    form: str = ".4g"
    note: str = ""

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Printed, corrected, AMI's and maximum likelihood's as text."""
        values = (self.ami, self.maximum_likelihood)
        corrected = "" if self.corrected is None else format(self.corrected, self.form)
        ours = tuple("" if value is None else estimate_text(value, self.form) for value in values)
        return self.printed, corrected, ours[0], ours[1]

    @property
    def over_draws(self) -> tuple[tuple[str, str, str], ...]:
        """Rows that stand below: what of the draws, AMI's and maximum likelihood's as text."""
        values = (self.ami, self.maximum_likelihood)
        found = [value for value in values if value is not None and len(value.draws) > 1]
        if not found:
            return ()
        rows = []
        for attribute, words in (("mean", "mean of"), ("worst", "worst of")):
            texts = [
                "" if value is None or not value.draws else format(getattr(value, attribute), self.form)
                for value in values
            ]
            rows.append((f"{words} {len(found[0].draws)} draws", texts[0], texts[1]))
        return tuple(rows)


def estimate_text(estimate: Estimate, form: str) -> str:
    """A value, with its deviation in units of the last digit where it has one: -0.0020003(19)."""
    std = estimate.std
    return format(estimate.value, form) if std is None or not 0.0 < std < np.inf else with_error(estimate.value, std)
