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

BASE = Path(__file__).resolve().parents[2]  # where netlib/ and layers/ lie: a clone, or site-packages
SHARE = BASE / "netlib" / "share"  # an installed package has the other folders of a clone in it (setup.py)
ROOT = SHARE if SHARE.is_dir() else BASE  # where fast/, prototxt/, models/ and tools/ lie
OWN_FOLDERS = ("prototxt", "models")  # that are installed, too
IS_CLONE = (ROOT / "setup.cfg").exists()  # False in an installed package
PROGRAM = "handpose"  # the command that an installed package has; its first word names a tool
_loading = lock()


def command(name: str) -> str:
    """The command line that starts a tool of this project: as the user started this one, else as it is installed."""
    if IS_CLONE and not is_subcommand():
        return f"python tools/{name}.py"
    return f"{PROGRAM} {name.replace('_', '-')}"


def is_subcommand() -> bool:
    """Was this process started as ``handpose NAME``? handpose/__main__.py sets its name."""
    return bool(sys.argv) and sys.argv[0].startswith(f"{PROGRAM} ")


def own(name: str) -> Path:
    """The place of a file or folder of this project by its name in a clone, also where it is installed."""
    return next((base / name for base in (ROOT, BASE) if exists(base / name)), ROOT / name)


def find(name: str, source: str | None) -> Path:
    """``name`` from the working directory (Caffe's way), else beside the file ``source`` that names it.

    A name such as ``prototxt/x.prototxt`` is also looked for in the folder ``prototxt`` in which ``source`` is, and if
    it begins like one of this project's own folders there, so that a solver can be used from any working directory;
    ``source`` None is the command line or a program. A file that is nowhere keeps its name, so that the error says what
    the user wrote.
    """
    path = Path(name)
    if path.is_absolute() or exists(path):
        return path
    return next((folder / path for folder in _folders(path, source) if exists(folder / path)), path)


def _folders(path: Path, source: str | None) -> Iterator[Path]:
    """Where a file that ``source`` names may be, in addition to the working directory."""
    if source is not None:
        yield Path(source).parent
    if len(path.parts) > 1:
        if source is not None:
            above = Path(source).absolute().parents
            yield from (folder.parent for folder in above if folder.name == path.parts[0])
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
    return load_module(name, own(name) / "__init__.py")


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
