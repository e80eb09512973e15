"""Files: read with limits and clear errors, replaced atomically, locked; HDF5 files, images, paths."""

from netlib.files.reading import (
    LARGEST,
    Identity,
    Source,
    identity,
    is_in_use,
    make_folder,
    noted,
    opened,
    read_bytes,
    read_pieces,
    read_text,
)

__all__ = [
    "LARGEST", "Identity", "Source", "identity", "is_in_use", "make_folder", "noted", "opened", "read_bytes",
    "read_pieces", "read_text",
]  # fmt: skip
