"""Files by name: those that a prototxt names, those that a folder holds."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from netlib.system.one_thread import lock

ROOT = Path(__file__).resolve().parents[2]  # of this project: where netlib/, layers/ and fast/ lie
OWN_FOLDERS = ("prototxt", "models")  # that are installed, too
IS_CLONE = (ROOT / "setup.cfg").exists()  # False in an installed package
_loading = lock()


def command(name: str) -> str:
    """The command line that starts a tool of this project: a file of a clone, a module of an installed package."""
    return f"python tools/{name}.py" if IS_CLONE else f"python -m tools.{name}"


def find(name: str, source: str | None) -> Path:
    """``name`` from the working directory (Caffe's way), else beside the file ``source`` that names it.

    A name such as ``prototxt/x.prototxt`` is also looked for in the folder ``prototxt`` in which ``source`` is, and if
    it begins like one of this project's own folders there, so that a solver can be used from any working directory. A
    file that is nowhere keeps its name, so that the error says what the user wrote.
    """
    path = Path(name)
    if path.is_absolute() or source is None or exists(path):
        return path
    return next((folder / path for folder in _folders(path, Path(source)) if exists(folder / path)), path)


def _folders(path: Path, source: Path) -> Iterator[Path]:
    """Where a file that ``source`` names may be, beside the working directory."""
    yield source.parent
    if len(path.parts) > 1:
        yield from (folder.parent for folder in source.absolute().parents if folder.name == path.parts[0])
        if path.parts[0] in OWN_FOLDERS:
            yield ROOT


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
