"""benchmarks/parts.py: every part of fast/ can be switched off, and the time it saves is a row of the table."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

import netlib
from benchmarks.paper import Paper
from netlib import fillers
from netlib.files.paths import ROOT
from tests.support.running import run_tool

parts = pytest.importorskip("benchmarks.parts")  # without fast/ there is nothing to time


def repeat_some(array: np.ndarray, draw: Callable[[int], np.ndarray]) -> None:
    """Fill an array with a prime number of random numbers, repeated, which is faster than to draw all."""
    array[...] = np.resize(draw(4093), array.shape)


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Paper]:
    """The paper's network on four frames."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fillers, "_draw", repeat_some)
        yield Paper(tmp_path_factory.mktemp("paper"), 2, 1)


@pytest.fixture(scope="module")
def deployed(paper: Paper) -> netlib.Net:
    """The net whose weights predict, with all parts of fast/."""
    return paper.deploy(2, "fast")


def trained_and_predicted(paper: Paper, weights: netlib.Net) -> list[np.ndarray]:
    """Return the weights of the first layer after a step, and the joints of two frames, twice, and of one."""
    solver = paper.solver(2, "fast")
    solver.step(1)
    net = netlib.Net(ROOT / "prototxt" / "nyu_deploy.prototxt", netlib.TEST, engine="fast")
    net.copy_from(weights)
    joints = [net.forward(depth=paper.depth[:count])["pred"].copy() for count in (2, 2, 1)]
    return [solver.net.params["convL1"][0].data.copy(), *joints]


@pytest.fixture(scope="module")
def expected(paper: Paper, deployed: netlib.Net) -> list[np.ndarray]:
    """The same with all parts of fast/."""
    return trained_and_predicted(paper, deployed)


@pytest.mark.parametrize("part", parts.PARTS)
def test_without_a_part(
    part: str, paper: Paper, deployed: netlib.Net, expected: list[np.ndarray], keep_threads: None
) -> None:
    """Without one part, a net trains and predicts the same up to rounding."""
    with parts.PARTS[part]():
        found = trained_and_predicted(paper, deployed)
    for ours, wanted in zip(found, expected):
        np.testing.assert_allclose(ours, wanted, rtol=0, atol=1e-5)


def test_the_table(keep_threads: None) -> None:
    """A named part has a row with ms and a share for each job."""
    options = ["--rounds", "1", "--burst", "1e-9", "--batch", "2", "--threads", "1", "--only", "single poses"]
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
