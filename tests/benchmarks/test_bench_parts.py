"""benchmarks/parts.py: every part of fast/ can be switched off, and the time it saves is a row of the table."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.paper import Paper
from tests.support.running import run_tool

parts = pytest.importorskip("benchmarks.parts")  # without fast/ there is nothing to time


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Paper:
    """The paper's network on four frames."""
    return Paper(tmp_path_factory.mktemp("paper"), 2, 1)


def trained_and_predicted(paper: Paper) -> list[np.ndarray]:
    """Return the weights of the first layer after a step, and the joints of two frames."""
    solver = paper.solver(2, "fast")
    solver.step(1)
    pred = paper.deploy(2, "fast").forward(depth=paper.depth[:2])["pred"]
    return [solver.net.params["convL1"][0].data.copy(), pred.copy()]


@pytest.fixture(scope="module")
def expected(paper: Paper) -> list[np.ndarray]:
    """The same with all parts of fast/."""
    return trained_and_predicted(paper)


@pytest.mark.parametrize("part", parts.PARTS)
def test_without_a_part(part: str, paper: Paper, expected: list[np.ndarray], keep_threads: None) -> None:
    """Without one part, a net trains and predicts the same up to rounding."""
    with parts.PARTS[part]():
        found = trained_and_predicted(paper)
    for ours, wanted in zip(found, expected):
        np.testing.assert_allclose(ours, wanted, rtol=0, atol=1e-5)


def test_the_table(keep_threads: None) -> None:
    """A named part has a row with ms and a share for each job."""
    options = ["--rounds", "1", "--burst", "1e-9", "--batch", "2", "--only", "single poses"]
    head, *rows = run_tool("benchmarks.parts", *options).out.splitlines()
    assert head.split()[3:] == ["step", "2", "forward", "2", "one", "image"]
    assert [row[:34].rstrip() for row in rows] == ["algorithm for single poses"]
    assert all(len(row[34:].split()) == 6 for row in rows)


@pytest.mark.parametrize(
    "options", [["--rounds", "0"], ["--threads", "-1"], ["--only", "slices", "nothing_such"]], ids=" ".join
)
def test_usage(options: list[str]) -> None:
    """Wrong usage gives argparse's message, which names the option, and status 2."""
    assert options[0] in run_tool("benchmarks.parts", *options, status=2).err.splitlines()[-1]
