"""A folder like the project's for running a document, in a process whose state is restored afterwards."""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import numpy as np

import netlib
from netlib.files import own_modules

ROOT = Path(__file__).resolve().parents[2]
CODE = [
    "netlib",
    "layers",
    "fast",
    "handpose",
    "exercises",
    "experiments",
    "export",
    "tools",
    "web",
    "docs",
]
LINKED = (*CODE, "tests", "setup.cfg", "Makefile")
COPIED = ("prototxt", "models")  # folders into which documents may write
LARGE = 100_000  # bytes; larger files are linked even there, and replaced when written, as all writers do


def furnish(folder: Path) -> Path:
    """Fill a new folder with the project's files, as links where nothing is written.

    Returns a folder with the programs ``python``, ``handpose`` and ``netlib``, as if the package were installed.
    """
    folder.mkdir()
    for name in LINKED:
        if (ROOT / name).exists():  # fast/ may be deleted
            (folder / name).symlink_to(ROOT / name)
    for name in COPIED:
        shutil.copytree(ROOT / name, folder / name, copy_function=_small_copy,
                        ignore=shutil.ignore_patterns("__pycache__"))
    python = folder.with_name(f"{folder.name}_python")
    python.mkdir()
    programs = {"python": "", "python3": ""}
    for name, function in (("handpose", "main"), ("netlib", "netlib")):  # as setup.cfg's console_scripts
        programs[name] = f'-c "from handpose.__main__ import {function}; {function}()"'
    for name, start in programs.items():
        (python / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {start} "$@"\n')
        (python / name).chmod(0o755)
    return python


def _small_copy(source: str, target: str) -> None:
    if Path(source).stat().st_size > LARGE:
        Path(target).symlink_to(source)
    else:
        shutil.copyfile(source, target)


def state() -> dict[str, tuple[int, int]]:
    """Return the modification time and size of each file that a document can reach."""
    found = {}
    for top in (*LINKED, *COPIED):
        for place, folders, names in os.walk(ROOT / top):
            folders[:] = [name for name in folders if name != "__pycache__"]
            for name in names:
                about = (Path(place) / name).lstat()
                found[f"{place}/{name}"] = (about.st_mtime_ns, about.st_size)
    return found


def written(before: dict[str, tuple[int, int]]) -> list[str]:
    """Return the files that were changed, added or removed."""
    now = state()
    return sorted(name for name in {*before, *now} if before.get(name) != now.get(name))


@contextlib.contextmanager
def at_work_in(folder: Path) -> Iterator[None]:
    """Use ``folder`` as the working folder; afterwards restore the imports, settings and random numbers."""
    before, modules = Path.cwd(), set(sys.modules)
    path, finders, argv, threads = list(sys.path), list(sys.meta_path), list(sys.argv), netlib.threads()
    drawn, numpys = random.getstate(), np.random.get_state()
    os.chdir(folder)
    sys.path.append(str(folder))  # last: the project's packages are still those of the tests
    try:
        with mock.patch.dict(os.environ, {"MPLBACKEND": "Agg"}), np.printoptions(), np.errstate():
            yield
    finally:
        if "matplotlib.pyplot" in sys.modules:
            sys.modules["matplotlib.pyplot"].close("all")
        os.chdir(before)
        sys.path[:], sys.meta_path[:], sys.argv[:] = path, finders, argv
        sys.modules.update(own_modules._aside)  # install_as_caffe takes them out, and its finder is gone now
        own_modules._aside.clear()
        for name in set(sys.modules) - modules:
            file = getattr(sys.modules[name], "__file__", None) or ""
            if name.split(".")[0] == "caffe" or file.startswith(f"{folder}{os.sep}"):
                del sys.modules[name]
        random.setstate(drawn)
        np.random.set_state(numpys)
        netlib.set_threads(threads)
