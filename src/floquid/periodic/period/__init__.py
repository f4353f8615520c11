"""The period from the response: lines of its spectrum, their families, and the FSE view."""

from floquid.periodic.period._estimate_period import PeriodCandidate, PeriodEstimate, estimate_period
from floquid.periodic.period._fse import FSE, Family, fse
