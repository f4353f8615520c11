"""Tests on a model: whether the system is periodic at all, and whether it turns with the period given."""

from floquid.periodic.significance._periodicity_test import PartialTests, Periodicity, on_a_mode, periodicity
from floquid.periodic.significance._wald import TURNED, Synchrony, drift, spacing, synchrony
