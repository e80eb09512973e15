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
from tests.tools.conftest import ROOT

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


EVALUATE = "nyu --groundtruth t.txt --predictions"


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("caffe train", "train needs -solver"),
        (
            "caffe train -solver s -snapshot a -weights b",
            "--weights: not allowed with argument --snapshot",
        ),
        ("caffe test -model m", "test needs -weights"),
        ("caffe time", "time needs -model"),
        ("caffe tarin -solver s", "invalid choice: 'tarin'"),
        ("caffe train -solver s -sigint_effect die", "invalid choice: 'die'"),
        ("compute_image_mean", "the following arguments are required: INPUT"),
        ("compute_image_mean -backend leveldb db", "argument --backend: invalid choice: 'leveldb'"),
        (
            "compute_image_mean -resize_width=3 list.txt",
            "-resize_width and -resize_height must be given together",
        ),
        ("draw_net net.prototxt net.png --phase DEPLOY", "invalid choice: 'DEPLOY'"),
        (f"evaluate {EVALUATE} a.txt", "argument --predictions: expected NAME=FILE, found 'a.txt'"),
        (f"evaluate {EVALUATE} =a.txt", "expected NAME=FILE, found '=a.txt'"),
        (f"evaluate {EVALUATE} A=", "expected NAME=FILE, found 'A='"),
        (f"evaluate {EVALUATE} A=a.txt A=b.txt", "--predictions: the name 'A' is given 2 times"),
        (f"evaluate {EVALUATE} A=a.txt --plot a.jpg", "suffix .png, .svg, .pdf, found 'a.jpg'"),
        (f"evaluate {EVALUATE} A=a.txt --format xyd", "invalid choice: 'xyd'"),
        (
            f"evaluate {EVALUATE} A=a.txt --angles".replace("nyu", "icvl"),
            "--angles applies only to nyu",
        ),
        (
            "export_onnx net w out --cube 0",
            "argument --cube: expected a number of at least 50 and at most 10000 mm",
        ),
        *(
            (
                f"finetune net w pictures {options}",
                "give --mean or --mean-file, and --scale, with which",
            )
            for options in ("", "--mean 104", "--scale 1")
        ),
        (
            "fit_pose uvd.txt --swarm --no-limits",
            "--swarm does not support --no-limits and --ridge",
        ),
        ("fit_pose uvd.txt --swarm --ridge 1", "--swarm does not support --no-limits and --ridge"),
        ("fit_pose uvd.txt --particles 64", "--particles applies only with --swarm"),
        ("fit_pose uvd.txt --generations 64", "--generations applies only with --swarm"),
        ("make_synthetic --train 0", "--train"),
        ("make_synthetic --workers -1", "--workers"),
        ("make_synthetic --seed 4294967296", "--seed"),
        (
            "make_synthetic --body b --recipe cameras",
            "--recipe applies only to hands; other bodies are",
        ),
        ("predict a.png --model net.prototxt", "--model needs --weights"),
        (
            "predict a.png --fit no --hand either",
            "--hand either needs a fit; use --hand right or left",
        ),
        (
            "predict a.png --camera kinect3",
            "expected a file, nyu, icvl, msra15, kinect2, sr305, d405, ",
        ),
        *(
            (
                f"predict a.png {option}",
                f"{option.split()[0]} applies only to full frames, with --camera",
            )
            for option in ("--center 1,2", "--unit 1", "--distortion 0,0,0,0", "--refine 2")
        ),
        ("predict a.png --camera nyu --center 1", "expected U,V or U,V,D (px, px, mm), found '1'"),
        (
            "predict a.png b.png --camera nyu" + 3 * " --center 1,2",
            "--center is given 3 times for 2 images; expected once, or once per image",
        ),
        ("predict a.png --refine 101", "expected an integer of at most 100, found '101'"),
        (
            "predict a.png --cube 0.3",
            "argument --cube: expected a number of at least 50 and at most 10000 mm",
        ),
        (
            "prepare_nyu root --center c.txt",
            "--center FILE applies to one split: select it with --splits, or use",
        ),
        (
            "run_net n w 0.png --mean 1 --mean-file m.npy",
            "--mean-file: not allowed with argument --mean",
        ),
        ("show_data a.h5 --out a.gif", "expected a file name with suffix .png, .jpg"),
        ("test net.caffemodel.h5 --deploy own.prototxt", "--deploy applies only with --fit"),
        (
            "test a.h5 --picture folder/.png",
            "--picture: expected a file name with suffix .png, found 'folder/.png'",
        ),
        (
            "track frames --look a.txt",
            "--look: expected a file name with suffix .png, .jpg, found 'a.txt'",
        ),
        ("track frames --look a.png --json a.json", "--look stops after the first frames"),
        (
            "track frames --json .json",
            "expected a file name with suffix .json, .jsonl, -, found '.json'",
        ),
        (
            "track frames --size 100",
            "--size: expected a number of at least 0.66 and at most 1.35, found '100'",
        ),
        ("train", "the following arguments are required: SOLVER"),
        ("train s --snapshot a --weights b", "--weights: not allowed with argument --snapshot"),
    ],
)
def test_wrong_usage(command: str, message: str) -> None:
    """Wrong arguments are rejected before a file is read."""
    assert message in run_tool(command, status=2).err.splitlines()[-1]


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
    assert "numpy" in done.stdout.split() and few & set(done.stdout.split()) == set()
