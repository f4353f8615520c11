"""Columns of samples and of times: what a file or an object says of a record, and the even time axis behind it."""

from floquid.tables._names import find_time, name_and_unit, numbered, rate_stated, says_rate, with_names
from floquid.tables._nominal_rate import Printed, fit_line, nominal_rate_of_step, printed, rate_of_step
from floquid.tables._rows import WholeLines, cut_note, is_cut
from floquid.tables._table import (
    MISSING,
    OPTION,
    Table,
    check_distinct,
    check_table,
    clock_numbers,
    counts_rows,
    make_channel,
    make_channels,
    number_in,
    numbers_of,
    orbit_of,
    real_row,
    record_of,
    refuse_blurred_times,
    rows_of,
    settle_axis,
    stated_number,
    texts_of,
    times_of,
    with_units,
    without_counters,
)
from floquid.tables._time_axis import SECONDS, TimeAxis, TimeColumn, repair

__all__ = [
    "MISSING", "OPTION", "SECONDS", "Printed", "Table", "TimeAxis", "TimeColumn", "WholeLines", "check_distinct",
    "check_table", "clock_numbers", "counts_rows", "cut_note", "find_time", "fit_line", "is_cut", "make_channel",
    "make_channels", "name_and_unit", "nominal_rate_of_step", "number_in", "numbered", "numbers_of", "orbit_of",
    "printed", "rate_of_step", "rate_stated", "real_row", "record_of", "refuse_blurred_times", "repair", "rows_of",
    "says_rate", "settle_axis", "stated_number", "texts_of", "times_of", "with_names", "with_units", "without_counters",
]  # fmt: skip
