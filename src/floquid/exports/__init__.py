"""Results for other programs: modes as CSV, MAT, JSON and universal files, `summary.json`, and xarray."""

from floquid.exports._modes import MODE_FORMATS, export_modes, modes_frame
from floquid.exports._objects import from_periodic_system, to_periodic_system, to_xarray
from floquid.exports._summary import summary
from floquid.exports._tables import (
    columns_text,
    comparison_columns,
    comparison_summary,
    edge_columns,
    monitor_columns,
    monitor_summary,
    path_columns,
    survey_columns,
    survey_summary,
)
from floquid.exports._transfer_tables import (
    TRANSFER_FORMATS,
    export_transfer,
    fit_entries,
    import_transfer,
    measured_entries,
    transfer_entries,
    transfer_rows,
)

__all__ = [
    "MODE_FORMATS", "TRANSFER_FORMATS", "columns_text", "comparison_columns", "comparison_summary", "edge_columns",
    "export_modes", "export_transfer", "fit_entries", "from_periodic_system", "import_transfer", "measured_entries",
    "modes_frame", "monitor_columns", "monitor_summary", "path_columns", "summary", "survey_columns", "survey_summary",
    "to_periodic_system", "to_xarray",
    "transfer_entries", "transfer_rows",
]  # fmt: skip
