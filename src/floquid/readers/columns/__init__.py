"""Files of columns with a heading each: text tables and Parquet."""

from floquid.readers.columns._csv import load_csv, save_csv
from floquid.readers.columns._parquet import load_parquet, save_parquet

__all__ = ["load_csv", "load_parquet", "save_csv", "save_parquet"]
