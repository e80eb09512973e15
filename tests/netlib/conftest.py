"""Solvers from text, and modules of Python layers."""

from __future__ import annotations

import importlib
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import netlib

MakeNet = Callable[..., netlib.Net]
MakeSolver = Callable[..., netlib.Solver]
MakeModule = Callable[[str, str], None]
RECORDINGS = Path(__file__).resolve().parents[1] / "caffe" / "solvers"


def furnish(folder: Path) -> None:
    """Copy a training with its state of version 0.1.0 to a folder: a small net, shuffled
    data, dropout.
    """
    shutil.copytree(Path(__file__).parent / "older", folder, dirs_exist_ok=True)
    (folder / "list.txt").write_text(f"{RECORDINGS}/train0.h5\n{RECORDINGS}/train1.h5\n")


def everything(solver: netlib.Solver) -> str:
    """All on which the rest of a training depends: iteration, losses, weights, histories,
    states of layers.
    """
    arrays = [*(p.blob.data for p in solver.net.learnable), *(a for h in solver.history for a in h)]
    states = [net.layer_states() for net in [solver.net, *solver.test_nets]]
    return f"{solver.iter} {list(solver.smoothed)} {states} {[array.tobytes() for array in arrays]}"


# Loss = (w x - t)² / 2 with x = 2, t = 1: dL/dw = 2 (2 w - 1). From w = 1 the gradient is 2.
WEIGHT_WITH = """
    layer { name: "x" type: "DummyData" top: "x" dummy_data_param { shape { dim: 1 dim: 1 } data_filler { value: 2 } } }
    layer { name: "t" type: "DummyData" top: "t" dummy_data_param { shape { dim: 1 dim: 1 } data_filler { value: 1 } } }
    layer { name: "ip" type: "InnerProduct" bottom: "x" top: "y" %s
            inner_product_param { num_output: 1 bias_term: false weight_filler { value: 1 } } }
    layer { name: "loss" type: "EuclideanLoss" bottom: "y" bottom: "t" top: "loss" }
"""
ONE_WEIGHT = WEIGHT_WITH % ""


@pytest.fixture
def solver_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> MakeSolver:
    """``solver_of(net, options)`` writes a solver and its net; the defaults are base_lr 0.1 and
    a fixed policy.
    """
    monkeypatch.chdir(tmp_path)

    def make(net: str, options: str = "", seed: int | None = None) -> netlib.Solver:
        (tmp_path / "net.prototxt").write_text(net)
        for default in (
            "base_lr: 0.1",
            'lr_policy: "fixed"',
            "max_iter: 100",
            'snapshot_prefix: "snap"',
        ):
            if default.split(":")[0] + ":" not in options:
                options += f" {default}"
        (tmp_path / "solver.prototxt").write_text(f'net: "net.prototxt" {options}')
        return netlib.get_solver("solver.prototxt", seed)

    return make


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> MakeModule:
    """``module(name, code)`` writes a module to the working directory, from which it
    can be imported.
    """
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)

    def write(name: str, code: str) -> None:
        Path(f"{name}.py").write_text(code)
        monkeypatch.delitem(sys.modules, name, raising=False)
        importlib.invalidate_caches()

    return write
