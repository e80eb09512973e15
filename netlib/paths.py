"""Find a file that a prototxt names."""

from __future__ import annotations

from pathlib import Path


def find(name: str, source: str | None) -> Path:
    """``name`` from the working directory (Caffe's way), else beside the file ``source`` that names it.

    A file that is in neither place keeps its name, so that the error says what the user wrote.
    """
    path = Path(name)
    if path.is_absolute() or source is None or exists(path):
        return path
    beside = Path(source).parent / path
    return beside if exists(beside) else path


def exists(path: Path) -> bool:
    """Is there such a file? No, if there cannot be."""
    try:
        return path.exists()
    except (OSError, ValueError):  # too long, or with characters that no file name has
        return False
