"""The size of the core. Allowed imports are checked by ``make lint`` (setup.cfg, ruff.toml)."""

from __future__ import annotations

import inspect
import textwrap

from netlib.layer import Layer
from netlib.solver import Solver
from tests.support.running import ROOT
from tests.test_totals import size_of


def test_the_core_can_be_read_in_an_afternoon() -> None:
    """The core has at most 14 files and 11,550 syntax nodes; ``__main__`` only starts commands."""
    core = sorted(path for path in (ROOT / "netlib").glob("*.py") if path.stem != "__main__")
    assert 8 < len(core) <= 14
    assert sum(size_of(path.read_text(encoding="utf-8")).nodes for path in core) <= 11_550


def test_the_training_loop_is_short() -> None:
    """The training loop has at most 130 syntax nodes."""
    assert size_of(textwrap.dedent(inspect.getsource(Solver.step))).nodes <= 130


def test_the_contract_of_a_layer_is_short() -> None:
    """A layer has at most 13 methods, including the constructor."""
    assert len([name for name, value in vars(Layer).items() if inspect.isfunction(value)]) <= 13
