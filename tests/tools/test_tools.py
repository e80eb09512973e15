"""Requirements of all tools: help, usage errors, and nets from untrusted sources."""

from __future__ import annotations

import functools
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from handpose import _MODULE_OF
from netlib import engine
from tests.support.running import run_tool
from tests.support.source_imports import imports
from tests.tools.conftest import ROOT, mistakes_of

FILES = sorted(path for path in (ROOT / "tools").glob("*.py") if path.stem != "__init__")
COMMANDS = [path.stem for path in FILES]
assert {"train", "test", "predict", "make_synthetic"} <= set(COMMANDS)
WITH_ENGINE = ["predict", "run_net", "test", "test_net", "time", "train"]


@functools.cache
def helps(name: str) -> str:
    return run_tool(name, "--help").out


@pytest.mark.parametrize("name", COMMANDS)
def test_help_is_the_docstring(name: str) -> None:
    """The help starts with the docstring as written; every command that runs one net has the
    same --engine.
    """
    assert importlib.import_module(f"tools.{name}").__doc__.strip() in helps(name)
    assert name not in WITH_ENGINE or f"--engine {{{','.join(engine.NAMES)}}}" in helps(name)


@functools.cache
def resolved(name: str) -> tuple[Path, ...]:
    """Return the files of this project, outside the engine, that an import may read."""
    name = _MODULE_OF.get(name.removeprefix("handpose."), name)  # of a public name of handpose
    if not name.startswith(("handpose.", "tools.", "exercises.", "export.")):
        return ()
    files = (
        ROOT.joinpath(*part.split(".")).with_suffix(".py")
        for part in (name, name.rpartition(".")[0])
    )
    return tuple(file for file in files if file.is_file())


def reached(path: Path) -> set[str]:
    """Return all imports of a file, including indirect ones outside the engine."""
    found: set[str] = set()
    todo = {path}
    while todo:
        for name in imports(todo.pop()) - found:
            found.add(name)
            todo.update(resolved(name))
    return found


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_that_runs_nets_can_refuse_code(name: str) -> None:
    """Exactly the commands that run nets have --no-python-layers, for nets from
    untrusted sources.
    """
    classes = {"netlib.net.Net", "netlib.solver.Solver"}
    runs_nets = bool(classes & reached(ROOT / "tools" / f"{name}.py"))
    assert ("--no-python-layers" in helps(name)) == runs_nets


@mistakes_of("wrong_usage")
def test_wrong_usage(argv: str, message: str) -> None:
    """Wrong arguments are rejected before a file is read."""
    assert message in run_tool(argv, status=2).err.splitlines()[-1]


PYTHON = """
layer { name: "x" type: "Input" top: "depth" input_param { shape { dim: 1 } } }
layer { name: "own" type: "Python" bottom: "depth" top: "pred" python_param { module: "gadget" layer: "Own" } }
"""


@pytest.mark.parametrize(
    "command",
    [
        "caffe time -model net.prototxt",
        "caffe train -solver solver.prototxt",
        "predict crop.png --model net.prototxt --weights net.prototxt",
        "train solver.prototxt",
    ],
)
def test_no_python_layers(command: str, here: Path) -> None:
    """--no-python-layers rejects the net before it runs code; the next call is unaffected."""
    Path("net.prototxt").write_text(PYTHON)
    Path("solver.prototxt").write_text('net: "net.prototxt" base_lr: 0.1 lr_policy: "fixed"')
    Path("gadget.py").write_text("class Own: pass")
    done = run_tool(f"{command} --no-python-layers", status=1)
    assert "layer 'own' is of type 'Python', which executes code" in done.err.splitlines()[-1]
    done = run_tool(command, status=1)
    assert "gadget.Own is not a subclass of netlib.Layer" in done.err.splitlines()[-1]
    sys.modules.pop("gadget")


def test_a_command_starts_without_what_few_need() -> None:
    """Rarely used parts of SciPy and matplotlib are imported on use, because they take a third of
    the start-up time.
    """
    names = [name for name in COMMANDS if name != "make_recording"]  # draws rotating hands
    code = f"import sys, {', '.join(f'tools.{name}' for name in names)}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    few = {
        "matplotlib",
        "scipy.io",
        "scipy.linalg",
        "scipy.sparse",
        "scipy.spatial",
        "scipy.special",
    }
    assert "numpy" in done.stdout.split()
    assert few & set(done.stdout.split()) == set()
