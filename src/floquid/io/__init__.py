"""Files on the disk: written whole or not at all, taken apart by libraries, refused in one grammar."""

from floquid.io._decoders import (
    LARGE_FORMAT,
    RESULT_ENDINGS,
    RESULT_FORMAT,
    array_in,
    attribute,
    is_elsewhere,
    is_mat_4,
    is_result,
    is_whole,
    letters,
    load_variables,
    mat_order,
    texts_in,
)
from floquid.io._files import (
    DamagedError,
    Source,
    as_path,
    atomic_path,
    flush,
    flush_folder,
    load_package,
    readable_file,
    refuse_wrong_name,
    seems_to_be,
)
from floquid.io._guard import GUARD

__all__ = [
    "GUARD", "LARGE_FORMAT", "RESULT_ENDINGS", "RESULT_FORMAT", "DamagedError", "Source", "array_in", "as_path",
    "atomic_path", "attribute", "flush", "flush_folder", "is_elsewhere", "is_mat_4", "is_result", "is_whole",
    "letters", "load_package", "load_variables", "mat_order", "readable_file", "refuse_wrong_name", "seems_to_be",
    "texts_in",
]  # fmt: skip
