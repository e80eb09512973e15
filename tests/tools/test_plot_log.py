"""tools/plot_log.py: plots of this project's logs and of Caffe's."""

import re
from pathlib import Path

import cv2
import pytest

from tests.support.running import refusal, run_tool
from tools import plot_log

LOG = """I20261121 01:57:02.9 1 solver.cpp:347] Iteration 0, Testing net (#0)
I20261121 01:57:02.9 1 solver.cpp:414]     Test net output #0: loss = 2.5 (* 1 = 2.5 loss)
I20261121 01:57:02.9 1 solver.cpp:239] Iteration 0 (0 iter/s, 0s/3 iters), loss = 2.4
I20261121 01:57:02.9 1 solver.cpp:258]     Train net output #0: loss = 2.4 (* 1 = 2.4 loss)
I20261121 01:57:02.9 1 sgd_solver.cpp:112] Iteration 0, lr = 0.02
I20261121 01:57:02.9 1 solver.cpp:239] Iteration 3 (9 iter/s, 0.3s/3 iters), loss = 1e-3
I20261121 01:57:02.9 1 solver.cpp:327] Iteration 6, loss = nan
"""


@pytest.fixture
def figures(monkeypatch):
    shown = []
    write = plot_log.outputs.write_figure

    def remember(path, figure, dpi):
        shown.append(figure)
        write(path, figure, dpi)

    monkeypatch.setattr(plot_log.outputs, "write_figure", remember)
    return shown


def test_logs_of_one_name_are_told_apart(here, figures):
    """Losses and test outputs are drawn with their iterations; logs with the same name have those
    of their folders.
    """
    for name in ("one", "two"):
        Path(name).mkdir()
        Path(name, "train.log").write_text(LOG)
    logs = [Path(name, "train.log") for name in ("one", "two")]
    done = run_tool("plot_log", *logs, "--out", "a.png")
    assert done == (0, "wrote a.png\n", "")
    assert cv2.imread("a.png") is not None
    losses, outputs = (axis.lines for axis in figures[0].axes)
    assert [line.get_label() for line in losses] == ["one/train", "two/train"]
    assert losses[0].get_xydata()[:2].tolist() == [[0, 2.4], [3, 0.001]]
    assert losses[0].get_xdata()[2] == 6
    assert outputs[0].get_xydata().tolist() == [[0, 2.5]]


def test_a_curve_of_one_point_is_seen(here, figures):
    """It has a marker, a long curve has none; all panels show the same iterations."""
    Path("short.log").write_text("Iteration 40, loss = 2\n")
    lines = [f"Iteration {i}, loss = {i}" for i in range(50)]
    Path("long.log").write_text(
        "\n".join(["Iteration 0, Testing", "Test net output #0: a = 1", *lines])
    )
    run_tool("plot_log", "short.log", "long.log", "--out", "a.png")
    losses, outputs = figures[0].axes
    assert [line.get_marker() for line in losses.lines] == ["o", ""]
    assert losses.get_xlim() == outputs.get_xlim()
    assert losses.get_xlim()[1] > 49
    run_tool("plot_log", "short.log", "--out", "b.png")
    first, last = figures[1].axes[0].get_xlim()
    assert first < 40 < last


@pytest.mark.parametrize(
    ("count", "said"), [(plot_log.MAX_PANELS, ""), (400, "drew the first 8 of 400 test outputs\n")]
)
def test_many_test_outputs(here, figures, count, said):
    """The first outputs have a panel each, and a line says that the others are not drawn; long
    names are cut.

    A name is not typeset.
    """
    names = [f"out{i:03d}" for i in range(count)]
    names[0] = r"begin$\wrong{$" + "x" * 60000
    lines = [f"Test net output #{i}: {name} = {i}" for i, name in enumerate(names)]
    Path("a.log").write_text("\n".join(["Iteration 0, loss = 1", *lines]))
    done = run_tool("plot_log", "a.log", "--out", "log.png")
    assert done.err == said
    loss, first, *titles = [axis.get_title() for axis in figures[0].axes]
    assert loss == "training loss"
    assert titles == [f"test out{i:03d}" for i in range(1, 8)]
    assert first.startswith(r"test begin\$\wrong{\$x")
    assert len(first) < 70
    assert [len(axis.lines) for axis in figures[0].axes] == [1] * 9


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        ("no.log", "no.log: "),
        ("hello.txt", "hello.txt: .*expected a training log"),
        ("a.svg --out log.xyz", "log.xyz: cannot write the image: .*png"),
        (
            "a.svg --out folder/../a.svg",
            "folder/../a.svg: is read in this run; expected another output",
        ),
    ],
)
def test_mistakes(here, argv, message):
    Path("a.svg").write_text(LOG)
    Path("hello.txt").write_text("hello")
    Path("folder").mkdir()
    assert re.match(message, refusal("plot_log", *argv.split()))
