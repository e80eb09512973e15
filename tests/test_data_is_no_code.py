"""What docs/reliability.md promises under "Security": nothing in the source can run what stands in a file of data."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from netlib import engine
from tests.support.source_imports import offenders, parsed

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("netlib", "layers", "fast", "handpose", "exercises", "export", "tools")
FILES = sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))

# What runs text or bytes as code, by the name that a program calls it by.
CALLS = {"eval", "exec", "compile", "__import__", "system", "popen", "execv", "execve", "spawnv", "import_module",
         "exec_module", "load_module", "spec_from_file_location", "run_path", "run_module"}  # fmt: skip
MODULES = {"pickle", "cPickle", "_pickle", "dill", "marshal", "shelve", "yaml", "subprocess", "code", "runpy", "ctypes",
           "joblib", "pty"}  # fmt: skip
# Where such a thing may stand, and why it runs nothing that a file of data says.
ALLOWED = {
    "netlib/building/python_layer.py": "a layer of type Python is code: python_layers=False, --no-python-layers",
    "netlib/caffe/__main__.py": "runs the script that the command line names",
    "handpose/importers/matlab_file.py": "starts handpose/importers/matlab_worker.py, without a shell",
    "netlib/files/hdf5_helper.py": "runs netlib/files/hdf5_check.py, without a shell",
    "netlib/files/paths.py": "load_module: this project's packages, and Python layers",
    "netlib/system/aliases.py": "names of modules that stand in this project",
    "handpose/moved.py": "the same",
    "handpose/__main__.py": "a command of this project, which stands in tools/",
    "netlib/engine/choice.py": "the folder fast/",
    "netlib/caffe/draw.py": "runs Graphviz's program dot, without a shell",
    "exercises/process.py": "starts itself, without a shell",
    "exercises/reading.py": "runs the solution of an exercise, which the command line names and is code",
    "export/onnx/graph.py": "the packages onnx and onnxruntime",
    "fast/blas.py": "asks NumPy's own BLAS library how many threads it has",
}


def dangers(tree: ast.Module) -> Iterator[str]:
    """What a source file has that could run what it reads."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from {alias.name.partition(".")[0] for alias in node.names} & MODULES
        elif isinstance(node, ast.ImportFrom):
            yield from {(node.module or "").partition(".")[0]} & MODULES
            yield from {alias.name for alias in node.names} & CALLS
        elif isinstance(node, ast.Call):
            yield from _in_call(node)


def _in_call(call: ast.Call) -> Iterator[str]:
    of = call.func.value.id if isinstance(call.func, ast.Attribute) and isinstance(call.func.value, ast.Name) else ""
    name = getattr(call.func, "attr", getattr(call.func, "id", ""))
    options = {option.arg: ast.unparse(option.value) for option in call.keywords}
    is_written_here = name == "import_module" and isinstance(call.args[0], ast.Constant)
    if name in CALLS and of != "re" and not is_written_here:
        yield name
    if (of, name) == ("np", "load") and options.get("allow_pickle") != "False":
        yield "np.load without allow_pickle=False"
    if options.get("allow_pickle") == "True" or options.get("shell") == "True":
        yield "allow_pickle or shell"


def test_the_files_are_found() -> None:
    """The other tests have something to look at, and the list of exceptions names no file that is gone."""
    assert len(FILES) > 150
    there = {name for name in ALLOWED if engine.has_fast() or not name.startswith("fast/")}
    assert there <= {str(path.relative_to(ROOT)) for path in FILES}


def test_no_file_of_data_is_run() -> None:
    """No eval, exec, pickle, yaml or shell; modules are imported by name in a few places only."""
    found = offenders({path.relative_to(ROOT).as_posix(): set(dangers(parsed(path))) for path in FILES})
    assert {name: what for name, what in found.items() if name not in ALLOWED} == {}
    assert [name for name in ALLOWED if name not in found and (ROOT / name).exists()] == []


@pytest.mark.parametrize(
    "text",
    ["eval(x)", "import pickle", "from yaml import load", "np.load(f)", "np.load(f, allow_pickle=True)", "os.system(x)",
     "__import__(x)", "from subprocess import run", "importlib.import_module(x)", "from builtins import exec"],
)  # fmt: skip
def test_what_is_looked_for_is_found(text: str) -> None:
    """Else the test above would be of no worth."""
    assert set(dangers(ast.parse(text)))


@pytest.mark.parametrize(
    "text", ["re.compile(x)", "np.load(f, allow_pickle=False)", "h5py.File(f)", "import_module('cv2')"]
)
def test_what_is_harmless_is_not(text: str) -> None:
    """Patterns, arrays and files of data."""
    assert not set(dangers(ast.parse(text)))
