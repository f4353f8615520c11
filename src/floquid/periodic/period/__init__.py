"""The period from the response: lines of its spectrum, and their families."""

from floquid.periodic.period._estimate_period import PeriodCandidate, PeriodEstimate, estimate_period
