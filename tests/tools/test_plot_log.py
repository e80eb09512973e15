"""tools/plot_log.py: plots of this project's logs and of Caffe's."""

import errno
from pathlib import Path

import cv2
import pytest

from netlib.errors import DataError
from tests.support.running import run_tool
from tools import plot_log

LOG = """I20261121 01:57:02.9 1 solver.cpp:347] Iteration 0, Testing net (#0)
I20261121 01:57:02.9 1 solver.cpp:414]     Test net output #0: loss = 2.5 (* 1 = 2.5 loss)
I20261121 01:57:02.9 1 solver.cpp:239] Iteration 0 (0 iter/s, 0s/3 iters), loss = 2.4
I20261121 01:57:02.9 1 solver.cpp:258]     Train net output #0: loss = 2.4 (* 1 = 2.4 loss)
I20261121 01:57:02.9 1 sgd_solver.cpp:112] Iteration 0, lr = 0.02
I20261121 01:57:02.9 1 solver.cpp:239] Iteration 3 (9 iter/s, 0.3s/3 iters), loss = 1e-3
I20261121 01:57:02.9 1 solver.cpp:327] Iteration 6, loss = nan
"""


def test_curves(tmp_path):
    """Losses and test outputs are read with their iterations, including NaN."""
    (tmp_path / "a.log").write_text(LOG)
    log = plot_log.read_log(tmp_path / "a.log")
    assert log.loss[:2] == [(0, 2.4), (3, 0.001)] and log.loss[2][0] == 6
    assert log.test == {"loss": [(0, 2.5)]}


def test_picture(tmp_path):
    """Two logs are plotted in one image."""
    for name in ("a", "b"):
        (tmp_path / f"{name}.log").write_text(LOG)
    out = tmp_path / "log.png"
    run_tool("plot_log", tmp_path / "a.log", tmp_path / "b.log", "--out", out)
    assert cv2.imread(str(out)) is not None


def test_logs_of_one_name_are_told_apart(tmp_path, monkeypatch):
    """Logs with the same name are labelled with their folders."""
    shown = []
    monkeypatch.setattr(plot_log.outputs, "write_figure", lambda path, figure, dpi: shown.append(figure))
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "train.log").write_text(LOG)
    logs = [str(tmp_path / name / "train.log") for name in ("one", "two")]
    run_tool("plot_log", *logs, "--out", "log.png")
    assert [line.get_label() for line in shown[0].axes[0].lines] == ["one/train", "two/train"]


@pytest.fixture
def figures(monkeypatch):
    """Collect the figures that the tool writes."""
    shown = []
    write = plot_log.outputs.write_figure

    def remember(path, figure, dpi):
        shown.append(figure)
        write(path, figure, dpi)

    monkeypatch.setattr(plot_log.outputs, "write_figure", remember)
    return shown


def test_many_test_outputs(tmp_path, figures):
    """The first outputs have a panel each, and a line says that the others are not drawn."""
    outs = "\n".join(f"Test net output #{i}: out{i:03d} = {i}" for i in range(400))
    (tmp_path / "a.log").write_text(f"Iteration 0, loss = 1\n{outs}\n")
    done = run_tool("plot_log", tmp_path / "a.log", "--out", tmp_path / "log.png")
    assert done.err == "drew the first 8 of 400 test outputs\n"
    titles = [axis.get_title() for axis in figures[0].axes]
    assert titles == ["training loss", *(f"test out{i:03d}" for i in range(8))]
    assert [len(axis.lines) for axis in figures[0].axes] == [1] * 9


def test_as_many_outputs_as_panels(tmp_path, figures):
    lines = [f"Test net output #{i}: out{i} = {i}" for i in range(plot_log.MAX_PANELS)]
    (tmp_path / "a.log").write_text("\n".join(["Iteration 0, loss = 1", *lines]))
    assert run_tool("plot_log", tmp_path / "a.log", "--out", tmp_path / "log.png").err == ""
    assert len(figures[0].axes) == 1 + plot_log.MAX_PANELS


def test_long_names_and_formulas(tmp_path, figures):
    """A long name is cut and not typeset."""
    name = "begin" + r"$\wrong{$" + "x" * 60000 + "end"
    (tmp_path / "a.log").write_text(f"Iteration 0, loss = 1\nTest net output #0: {name} = 2\n")
    run_tool("plot_log", tmp_path / "a.log", "--out", tmp_path / "log.png")
    title = figures[0].axes[1].get_title()
    assert title.startswith(r"test begin\$\wrong{\$x") and len(title) < 70


def test_a_picture_that_cannot_be_written(tmp_path, monkeypatch):
    """A failed write keeps the old image and leaves no other file."""

    def half(figure, file, **how):
        Path(file).write_bytes(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / "a.log").write_text(LOG)
    (tmp_path / "log.png").write_bytes(b"the old picture")
    monkeypatch.setattr("matplotlib.figure.Figure.savefig", half)
    done = run_tool("plot_log", tmp_path / "a.log", "--out", tmp_path / "log.png", status=1)
    expected = f"{tmp_path}/log.png: cannot write the image: No space left on device\n"
    assert done[1:] == ("", expected)
    assert (tmp_path / "log.png").read_bytes() == b"the old picture"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.log", "log.png"]


def test_a_format_that_is_not_known(tmp_path):
    """An unknown format gives one line with the known ones."""
    (tmp_path / "a.log").write_text(LOG)
    error = run_tool("plot_log", tmp_path / "a.log", "--out", tmp_path / "log.xyz", status=1).err
    assert error.startswith(f"{tmp_path}/log.xyz: cannot write the image: ") and "png" in error
    assert error.count("\n") == 1 and [path.name for path in tmp_path.iterdir()] == ["a.log"]


def test_a_log_is_not_drawn_over(tmp_path):
    """A log is not overwritten by a plot, regardless of its name or path."""
    (tmp_path / "a.svg").write_text(LOG)
    (tmp_path / "folder").mkdir()
    done = run_tool("plot_log", tmp_path / "a.svg", "--out", f"{tmp_path}/folder/../a.svg", status=1)
    assert "is read in this run; expected another output" in done.err
    assert (tmp_path / "a.svg").read_text() == LOG


def test_caffes_own_log(caffe_data):
    """A log recorded from Caffe is read completely."""
    log = plot_log.read_log(caffe_data / "logs" / "deepmodel_train.log")
    assert len(log.loss) == 51 and log.loss[-1] == (50, 0.990677)
    assert log.test["DeepHandModelxyzloss"][-1] == (50, 1.02335)


def test_mistakes(tmp_path):
    """A file that is not a log, and a missing file, raise an error."""
    (tmp_path / "no.log").write_text("hello")
    with pytest.raises(DataError, match="expected a training log"):
        plot_log.read_log(tmp_path / "no.log")
    run_tool("plot_log", tmp_path / "missing.log", status=1)
