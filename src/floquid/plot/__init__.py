"""Figures for papers: each function takes floquid's own types and returns a matplotlib `Figure` that it alone owns.

matplotlib is loaded when the first figure is drawn, without pyplot and without touching its global settings.
"""

from floquid.plot._composite import composite
from floquid.plot._save import save_figures
from floquid.plot._system_elements import system_elements
from floquid.plot._time_record import time_record

__all__ = ["composite", "save_figures", "system_elements", "time_record"]
