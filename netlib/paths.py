"""Files by name: those that a prototxt names, those that a folder holds."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType

from netlib.one_thread import lock

ROOT = Path(__file__).resolve().parent.parent  # of this project: where netlib/, layers/ and fast/ lie
_loading = lock()


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


def names_in(folder: Path) -> set[str]:
    """The names of all that a folder holds; of what is not there or cannot be read, nothing."""
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        return {entry.name for entry in entries}
    return set()


def own_package(name: str) -> ModuleType:
    """This project's package ``layers`` or ``fast``, whatever else of this name Python would find first.

    A module of this name that was imported before netlib was stays what it is.
    """
    return load_module(name, ROOT / name / "__init__.py")


def load_module(name: str, path: Path) -> ModuleType:
    """The module in a file, imported under this name, once; what its code raises is raised."""
    with _loading:  # another thread that asks for it must not get half a module
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
