"""The size of the core. Allowed imports are checked by ``make lint`` (setup.cfg, ruff.toml)."""

from __future__ import annotations

import ast
import inspect
import textwrap
from pathlib import Path

from netlib.layer import Layer
from netlib.solver import Solver

ROOT = Path(__file__).resolve().parents[1]


def test_the_core_has_few_files() -> None:
    assert 8 < len(list((ROOT / "netlib").glob("*.py"))) <= 14


def test_the_training_loop_is_short() -> None:
    loop = ast.parse(textwrap.dedent(inspect.getsource(Solver.step)))
    assert sum(isinstance(node, ast.stmt) for node in ast.walk(loop)) <= 24


def test_the_contract_of_a_layer_is_short() -> None:
    """A layer has at most 13 methods, including the constructor."""
    assert len([name for name, value in vars(Layer).items() if inspect.isfunction(value)]) <= 13
