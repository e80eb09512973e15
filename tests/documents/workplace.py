"""A folder like the project's for running a document, in a process whose state is
restored afterwards.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import numpy as np

import netlib
from netlib.files import own_modules
from tests.support.running import ROOT

COPIED = ("prototxt", "models")  # folders into which documents may write
UNTRACKED = ("data", "snapshots", "site", "build", "demo")
LINKED = [
    path.name
    for path in ROOT.iterdir()
    if path.name not in (*COPIED, *UNTRACKED) and path.name[0] != "."
]
# bytes; larger files are linked even there, and replaced when written, as all writers do
LARGE = 100_000


def furnish(folder: Path) -> None:
    """Fill a new folder with the project's files, as links where nothing is written, and
    programs in .venv/bin.
    """
    folder.mkdir()
    for name in LINKED:
        (folder / name).symlink_to(ROOT / name)
    for name in COPIED:
        shutil.copytree(
            ROOT / name,
            folder / name,
            copy_function=_small_copy,
            ignore=shutil.ignore_patterns("__pycache__"),
        )
    (folder / ".venv" / "bin").mkdir(parents=True)
    programs = {"python": "", "python3": ""}
    # as setup.cfg's console_scripts
    for name in ("handpose", "netlib"):
        programs[name] = f'-c "from {name}.__main__ import main; main()"'
    for name, start in programs.items():
        program = folder / ".venv" / "bin" / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {start} "$@"\n')
        program.chmod(0o755)


def _small_copy(source: str, target: str) -> None:
    if Path(source).stat().st_size > LARGE:
        Path(target).symlink_to(source)
    else:
        shutil.copyfile(source, target)


@contextlib.contextmanager
def at_work_in(folder: Path) -> Iterator[None]:
    """Use ``folder`` as the working folder; afterwards restore the imports, settings and
    random numbers.
    """
    before = Path.cwd()
    modules = set(sys.modules)
    threads = netlib.threads()
    drawn = np.random.get_state()
    os.chdir(folder)
    try:
        with (
            mock.patch.dict(os.environ, {"MPLBACKEND": "Agg"}),
            np.printoptions(),
            np.errstate(),
            # last: the project's packages stay the tests'
            mock.patch.object(sys, "path", [*sys.path, str(folder)]),
            mock.patch.object(sys, "meta_path", [*sys.meta_path]),
            mock.patch.object(sys, "argv", [*sys.argv]),
        ):
            yield
    finally:
        if "matplotlib.pyplot" in sys.modules:
            sys.modules["matplotlib.pyplot"].close("all")
        os.chdir(before)
        # install_as_caffe takes them out, and its finder is gone now
        sys.modules.update(own_modules._aside)
        own_modules._aside.clear()
        for name in set(sys.modules) - modules:
            file = getattr(sys.modules[name], "__file__", None) or ""
            if name.split(".")[0] == "caffe" or file.startswith(f"{folder}{os.sep}"):
                del sys.modules[name]
        np.random.set_state(drawn)
        netlib.set_threads(threads)
