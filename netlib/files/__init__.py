"""File access: reading with limits and clear errors, atomic replacement, locks, HDF5,
images, paths.
"""

from netlib.files.reading import (
    MAX_BYTES,
    Content,
    Source,
    is_in_use,
    make_folder,
    noted,
    opened,
    read_bytes,
    read_text,
)

__all__ = [
    "MAX_BYTES",
    "Content",
    "Source",
    "is_in_use",
    "make_folder",
    "noted",
    "opened",
    "read_bytes",
    "read_text",
]
