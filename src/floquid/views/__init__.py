"""Content of figures as numbers: shared by `plot`, which draws them on paper, and `reporting`, on the page.

Nothing here draws, and no plotting library is loaded.
"""

from floquid.views._exponents import (
    Family,
    ShapeCurves,
    closed_period,
    ellipse,
    end_of_lines,
    exponent_ellipses,
    families,
    in_strip,
    magnitude_bands,
    multiplier_ellipses,
    phase_degrees,
    region_on_branch,
    shape_curves,
    unfolded,
)
from floquid.views._mode_table import (
    DAMPING_WORDS,
    MODE_NOTES,
    DampingUnit,
    ModeTable,
    branch_of,
    branch_words,
    check_damping_unit,
    couple_words,
    decrement,
    mode_notes,
    mode_numbers,
    mode_table,
    note_meanings,
    with_error,
)
from floquid.views._names import (
    Ink,
    SpeedUnit,
    check_analysis,
    element_unit,
    grows,
    in_unit,
    input_unit,
    over_label,
    over_unit,
    shortened,
    speed_texts,
    speed_unit,
    speed_words,
)
from floquid.views._outcome import (
    cycle_words,
    done_words,
    in_short,
    outcome_lines,
    passed_words,
    period_words,
    whitening_words,
)
from floquid.views._sidebands import impedance
from floquid.views._spectra import (
    SpectraOfModes,
    Spectrum,
    Synthesis,
    envelope,
    lifted_points,
    lifted_spectrum,
    raw_noise,
    record_spectrum,
    spectra_of_modes,
    synthesis,
)
from floquid.views._synchronisation import Synchronisation, synchronisation
from floquid.views._three_phase import to_alpha_beta, to_dq, to_sequence

__all__ = [
    "DAMPING_WORDS", "MODE_NOTES", "DampingUnit", "Family", "ModeTable", "ShapeCurves", "SpectraOfModes", "Spectrum",
    "SpeedUnit", "Synchronisation", "Synthesis", "branch_of", "branch_words", "check_analysis", "check_damping_unit",
    "closed_period", "couple_words", "cycle_words", "decrement", "done_words", "element_unit", "ellipse", "envelope",
    "exponent_ellipses", "families", "grows", "impedance", "in_short", "in_strip", "in_unit", "input_unit",
    "lifted_points", "lifted_spectrum", "magnitude_bands", "mode_notes", "mode_numbers", "mode_table",
    "multiplier_ellipses", "note_meanings", "outcome_lines", "over_label", "over_unit", "passed_words", "period_words",
    "phase_degrees", "raw_noise", "record_spectrum", "region_on_branch", "shape_curves", "shortened",
    "spectra_of_modes", "speed_texts", "speed_unit", "speed_words", "synchronisation", "synthesis", "to_alpha_beta",
    "to_dq", "to_sequence", "unfolded", "whitening_words", "with_error",
]  # fmt: skip
