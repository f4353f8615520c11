"""Files on the disk: written whole or not at all, taken apart by libraries, refused in one grammar."""

from floquid.io._files import as_path, atomic_path, flush, flush_folder, readable_file
from floquid.io._guard import GUARD
from floquid.io._hdf5 import array_in, attribute, is_elsewhere, is_whole, texts_in
from floquid.io._matlab import letters, load_variables, mat_order
from floquid.io._source import DamagedError, Source, load_package, refuse_wrong_name

__all__ = [
    "GUARD", "DamagedError", "Source", "array_in", "as_path", "atomic_path", "attribute", "flush", "flush_folder",
    "is_elsewhere", "is_whole", "letters", "load_package", "load_variables", "mat_order", "readable_file",
    "refuse_wrong_name", "texts_in",
]  # fmt: skip
