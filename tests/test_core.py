"""The size of the core. Allowed imports are checked by ``make lint`` (setup.cfg, ruff.toml)."""

from __future__ import annotations

import inspect
from pathlib import Path

from netlib.layer import Layer
from netlib.solver import Solver

ROOT = Path(__file__).resolve().parents[1]


def lines_of(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def test_the_core_can_be_read_in_an_afternoon() -> None:
    """The core has at most 14 files and 2,330 lines."""
    core = sorted((ROOT / "netlib").glob("*.py"))
    assert 8 < len(core) <= 14
    assert sum(map(lines_of, core)) <= 2330


def test_the_training_loop_is_short() -> None:
    """The training loop has at most 22 lines."""
    assert len(inspect.getsource(Solver.step).splitlines()) <= 22


def test_the_contract_of_a_layer_is_short() -> None:
    """A layer has at most 13 methods, including the constructor."""
    assert len([name for name, value in vars(Layer).items() if inspect.isfunction(value)]) <= 13


def test_convolution_and_pooling_are_short() -> None:
    """Convolution and pooling have at most 120 lines each."""
    assert max(lines_of(ROOT / f"layers/vision/{name}.py") for name in ("convolution", "pooling")) <= 120
