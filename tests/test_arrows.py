"""Who may import whom: netlib, layers, then fast and handpose, then tools, docs; and every file says what it is."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path

import pytest
from source_imports import imports, offenders, parsed

ROOT = Path(__file__).resolve().parents[1]
MAY_IMPORT = {  # besides itself
    "netlib": set(),
    "layers": {"netlib"},
    "fast": {"netlib", "layers"},
    "handpose": {"netlib", "layers"},
    "tools": {"netlib", "layers", "handpose"},
    "docs": {"netlib", "layers", "handpose", "tools"},
}
CORE = {"numpy", "scipy", "cv2", "h5py"}
EXTRAS = {"netlib/distributed/mpi.py": {"mpi4py"}}  # of an extra, imported where it is used
SHARED_BY_LAYERS = {
    "layers.hand.skeleton",
    "layers.hand.skeleton_file",
    "layers.hand.kinematics",
    "layers.loss.labels",
    "layers.recurrent.lstm_unit",
    "layers.recurrent.recurrent",
    "layers.vision.convolution",
    "layers.data.lmdb_file",
    "layers.data.transform",
    "layers.data.images",
    "layers.data.reader",
    "layers.data.datum",
}  # what several layers compute or read, no layer types; but Deconvolution and Im2col are parts of a Convolution, and
# an LSTM is a row of LSTMUnits
FILES = sorted(path for package in MAY_IMPORT for path in (ROOT / package).rglob("*.py"))


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_the_packages_are_found() -> None:
    """The other tests have something to look at."""
    assert len(FILES) > 50


def test_arrows_point_down() -> None:
    """No package imports one above it, and fast is imported by nobody: without its folder all else works."""
    wrong = {}
    for path in FILES:
        package = path.relative_to(ROOT).parts[0]
        others = {name.split(".")[0] for name in imports(path)} & (set(MAY_IMPORT) - {package})
        wrong[name_of(path)] = others - MAY_IMPORT[package]
    assert offenders(wrong) == {}


def test_only_the_core_packages_are_needed() -> None:
    """netlib, layers and fast run with numpy, scipy, cv2 and h5py."""
    wrong = {}
    for path in FILES:
        if path.relative_to(ROOT).parts[0] in ("netlib", "layers", "fast"):
            outside = {name.split(".")[0] for name in imports(path)} - set(sys.stdlib_module_names) - set(MAY_IMPORT)
            wrong[name_of(path)] = outside - CORE - EXTRAS.get(name_of(path), set())
    assert offenders(wrong) == {}


def test_layers_do_not_import_layers() -> None:
    """A layer can be read without opening another one."""
    wrong = {}
    for path in (ROOT / "layers").glob("*/*.py"):
        found = {".".join(name.split(".")[:3]) for name in imports(path) if name.startswith("layers.")}
        wrong[name_of(path)] = found - SHARED_BY_LAYERS
    assert offenders(wrong) == {}


@pytest.mark.parametrize(("package", "place"), [("layers", "proto/options.py"), ("fast", "engine/choice.py")])
def test_netlib_asks_for_layers_and_fast_in_one_place_each(package: str, place: str) -> None:
    """By name, when they are needed."""
    users = [
        path.relative_to(ROOT / "netlib").as_posix()
        for path in (ROOT / "netlib").rglob("*.py")
        if re.search(rf'(import_module|own_package)\(f?"{package}\b', path.read_text(encoding="utf-8"))
    ]
    assert users == [place]


def test_the_textbook_knows_nothing_of_speed() -> None:
    """No threads, tiles, buffers or BLAS in netlib/ and layers/.

    One file knows threads: those of a user, and what becomes of them in a forked process.
    """
    words = re.compile(r"import threading|concurrent\.futures|\btiles?\b|\.buffer\b|openblas", re.IGNORECASE)
    files = [path for package in ("netlib", "layers") for path in (ROOT / package).rglob("*.py")]
    assert len(files) > 40
    found = {str(path.relative_to(ROOT)) for path in files if words.search(path.read_text(encoding="utf-8"))}
    others = {"layers/__init__.py", "layers/common/tile.py"}  # where Caffe's layer type Tile stands
    # locks and a watch, so that threads do not get into each other
    safe = {"netlib/files/reading.py", "netlib/files/hdf5_helper.py", "netlib/system/one_thread.py"}
    assert found == others | safe


def test_every_file_opens_with_a_docstring() -> None:
    """What it is, before anything else."""
    assert [name_of(path) for path in FILES if not ast.get_docstring(parsed(path))] == []
