"""The core is small and knows nothing of what surrounds it. Who may import whom is checked by ``make lint``."""

from __future__ import annotations

import ast
import inspect
import re
import sys
from pathlib import Path

import pytest

from netlib.layer import Layer
from netlib.solver import Solver
from tests.support.source_imports import imports, offenders, parsed

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("netlib", "layers", "fast", "handpose", "exercises", "export", "tools", "docs")
CORE = sorted((ROOT / "netlib").glob("*.py"))
DEPENDENCIES = {"numpy", "scipy", "cv2", "h5py"}
EXTRAS = {"netlib/distributed/mpi.py": {"mpi4py"}}  # of an extra, imported where it is used
SHARED_BY_LAYERS = {
    "layers.hand.hand_model",
    "layers.hand.skeleton",
    "layers.hand.skeleton_file",
    "layers.hand.kinematics",
    "layers.loss.labels",
    "layers.recurrent.lstm_unit",
    "layers.recurrent.recurrent",
    "layers.vision.convolution",
    "layers.vision.windows",
    "layers.data.lmdb_file",
    "layers.data.reader",
    "layers.data.transform",
    "layers.data.images",
    "layers.data.datum",
}  # what several layers compute or read, no layer types; but Deconvolution and Im2col are parts of a Convolution, an
# LSTM is a row of LSTMUnits, and a SizedHandModel is a HandModel
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def test_the_core_can_be_read_in_an_afternoon() -> None:
    """At most 14 files and 2,200 lines stand in front."""
    assert 8 < len(CORE) <= 14
    assert sum(len(path.read_text(encoding="utf-8").splitlines()) for path in CORE) <= 2200


def test_the_core_knows_no_processes_signals_or_undo() -> None:
    """Neither its code nor its comments; ``netlib/__init__.py`` shows the names of all packages."""
    words = re.compile(r"\branks?\b|\bmpi\b|\bsignals?\b|\bundo\b|\brequested\b|\bchecksum\b", re.IGNORECASE)
    wrong = {
        name_of(path): set(words.findall(path.read_text(encoding="utf-8")))
        for path in CORE
        if path.name != "__init__.py"
    }
    assert offenders(wrong) == {}


def test_the_training_loop_is_short() -> None:
    """22 lines."""
    assert len(inspect.getsource(Solver.step).splitlines()) <= 22


def test_the_contract_of_a_layer_is_short() -> None:
    """12 methods, with the constructor."""
    assert len([name for name, value in vars(Layer).items() if inspect.isfunction(value)]) <= 12


def test_layers_name_their_parameters() -> None:
    """No layer needs to know which parameter has which number."""
    found = [name_of(path) for path in (ROOT / "layers").rglob("*.py") if "self.blobs[" in path.read_text("utf-8")]
    assert found == []


def test_only_the_core_packages_are_needed() -> None:
    """netlib, layers and fast run with numpy, scipy, cv2 and h5py."""
    wrong = {}
    for path in FILES:
        if path.relative_to(ROOT).parts[0] in ("netlib", "layers", "fast"):
            outside = {name.split(".")[0] for name in imports(path)} - set(sys.stdlib_module_names) - set(PACKAGES)
            wrong[name_of(path)] = outside - DEPENDENCIES - EXTRAS.get(name_of(path), set())
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
