"""Records from and to objects in memory: pandas, xarray, and the dictionaries of SEP005."""

from floquid.readers.objects._pandas import from_pandas, to_pandas
from floquid.readers.objects._sep005 import from_sep005, to_sep005
from floquid.readers.objects._xarray import from_xarray, record_to_xarray

__all__ = ["from_pandas", "from_sep005", "from_xarray", "record_to_xarray", "to_pandas", "to_sep005"]
