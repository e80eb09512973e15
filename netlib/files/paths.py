"""Finding files: those that a prototxt names, and those of this project."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from netlib.errors import DataError
from netlib.files import reading

# parent of netlib/ and layers/: a clone, or site-packages
BASE = Path(__file__).resolve().parents[2]
# in an installed package, the parent of a clone's other folders (setup.py)
SHARE = BASE / "netlib" / "share"
ROOT = SHARE if SHARE.is_dir() else BASE  # parent of fast/, prototxt/, models/ and tools/
OWN_FOLDERS = ("prototxt", "models")  # these are installed too
_loading = threading.RLock()


def own(name: str) -> Path:
    """Path of a file or folder of this project, given its path in a clone, also in an
    installed package.
    """
    return next((base / name for base in (ROOT, BASE) if exists(base / name)), ROOT / name)


def find(name: str, source: str | None) -> Path:
    """Resolve ``name`` relative to the working directory, as Caffe does, else to the file
    ``source`` that names it.

    A name such as ``prototxt/x.prototxt`` is also resolved relative to the parent of the folder
    ``prototxt`` that contains ``source``, and, if it starts with a folder of this project, relative
    to the project, so that a solver can be used from any working directory. ``source`` is None on
    the command line and in programs. If nothing is found, ``name`` is returned unchanged for the
    error message.
    """
    path = Path(name)
    if path.is_absolute() or exists(path):
        return path
    return next((folder / path for folder in _folders(path, source) if exists(folder / path)), path)


def _folders(path: Path, source: str | None) -> Iterator[Path]:
    """Folders to search for ``path``, in addition to the working directory."""
    if source is not None:
        yield Path(source).parent
    if len(path.parts) > 1:
        if source is not None:
            above = Path(source).absolute().parents
            yield from (folder.parent for folder in above if folder.name == path.parts[0])
        if path.parts[0] in OWN_FOLDERS:
            yield ROOT


def exists(path: Path) -> bool:
    """Whether the file exists; False for names that no file can have."""
    try:
        return path.exists()
    except (OSError, ValueError):  # too long, or with invalid characters
        return False


def real(path: str | Path) -> Path:
    """The absolute path without links; a name that no file can have is returned unchanged."""
    try:
        return Path(os.path.realpath(path))
    except (OSError, ValueError):
        return Path(path)


def names_in(folder: Path) -> set[str]:
    """Names of all entries of a folder; empty if it cannot be read."""
    with contextlib.suppress(DataError):
        return list_folder(folder)
    return set()


def list_folder(folder: Path) -> set[str]:
    """Names of all entries of a folder. Raises DataError if it cannot be read."""
    with reading.refused(folder, "the folder"), os.scandir(folder) as entries:
        return {entry.name for entry in entries}


def load_module(name: str, path: Path) -> ModuleType:
    """Import a module from a file under this name, once. Exceptions of its code are passed on."""
    with _loading:  # so that no other thread gets a partially imported module
        if name not in sys.modules:
            spec = importlib.util.spec_from_file_location(name, path)
            assert spec is not None and spec.loader is not None
            sys.modules[name] = module = importlib.util.module_from_spec(spec)
            try:
                spec.loader.exec_module(module)
            except BaseException:
                del sys.modules[name]
                raise
        return sys.modules[name]
