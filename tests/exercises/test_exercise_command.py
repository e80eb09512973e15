"""The command: it lists, begins and checks an exercise, and says plainly why it does not."""

from __future__ import annotations

from pathlib import Path

import pytest

from exercises.table import EXERCISES
from tests.tools.conftest import ROOT
from tools import exercise as command


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_list(work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every exercise with its chapter, and how to begin."""
    assert command.main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[1] for line in lines[:-1]] == list(EXERCISES)
    assert lines[-1] == "Begin one: python tools/exercise.py relu --start"


@pytest.mark.parametrize("name", EXERCISES)
def test_start(name: str, work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The stub of docs/exercises, in the working folder; somebody's work is never overwritten."""
    assert command.main([name, "--start"]) == 0
    path = work / f"{name}.py"
    assert path.read_bytes() == (ROOT / "docs" / "exercises" / path.name).read_bytes()
    assert capsys.readouterr().out.startswith(f"wrote {name}.py: ")
    path.write_text("mine")
    assert command.main([name, "--start"]) == 1
    assert capsys.readouterr().err == f"{name}.py: is there already, and stays as it is; remove it to begin anew\n"
    assert path.read_text() == "mine"


def test_a_solution(work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A tick for each step, and where ours is."""
    (work / "split.py").write_text((ROOT / EXERCISES["split"].file).read_text(encoding="utf-8"))
    assert command.main(["split", "--iterations", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "Split: one blob for several readers (split.py)"
    assert [line[0] for line in lines[1:-1]] == ["✓"] * 5
    assert lines[-1] == "All of it is right. Ours, to compare: layers/common/split.py"


def test_a_file_that_is_not_right(work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Status 1; the step that fails is the last, and its lines fit on a screen."""
    text = (ROOT / EXERCISES["split"].file).read_text(encoding="utf-8")
    Path("mine.py").write_text(text.replace("bottom[0].diff[...] += y.diff", "bottom[0].diff[...] = y.diff"))
    assert command.main(["split", "--file", "mine.py"]) == 1
    lines = capsys.readouterr().out.splitlines()
    failed = next(i for i, line in enumerate(lines) if line.startswith("✗"))
    assert lines[failed - 1].startswith("✓ values")
    rest = lines[failed + 1 :]
    assert all(line.startswith("    ") and len(line) <= 120 for line in rest)
    assert "dx is the gradient of the last reader alone" in " ".join(rest)
    assert rest[-1].startswith("    Look at Split.backward, mine.py:")


def test_the_file_here_comes_first(work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Then that of docs/exercises; where neither is, it says how to get one."""
    assert command.main(["relu"]) == 1
    assert f"({ROOT / 'docs/exercises/relu.py'})" in capsys.readouterr().out
    (work / "relu.py").write_text("x = 1\n")
    assert command.main(["relu"]) == 1
    assert capsys.readouterr().err.startswith("relu.py: has no ReLU.setup")


def test_no_file_at_all(work: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """As where the tools are installed without docs/."""
    monkeypatch.setattr(command, "ROOT", work)
    assert command.main(["relu"]) == 1
    assert capsys.readouterr().err == "relu.py: is not there; python tools/exercise.py relu --start writes one\n"


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["relo"], "there is no exercise 'relo' (did you mean 'relu'?); there are relu, inner_product"),
        (["--start"], "--start and --file need the NAME of an exercise"),
        (["EuclideanLoss"], "(did you mean 'euclidean_loss'?)"),
        (["--file", ""], "--start and --file need the NAME of an exercise"),
        (["--file", "relu.py"], "--start and --file need the NAME of an exercise"),
        (["relu", "--start", "--file", "mine.py"], "--start writes NAME.py; give --file when you check it"),
        (["relu", "--iterations", "-1"], "expected a whole number"),
    ],
)
def test_wrong_usage(argv: list[str], said: str, work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Status 2, and the line that helps."""
    with pytest.raises(SystemExit) as stopped:
        command.main(argv)
    assert stopped.value.code == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import os; os._exit(0)", "its process ended with status 0 in the middle of the check"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "its process ended with status -9 in the middle"),
        ("import os; os.closerange(0, 100)", "its process ended with status"),
        ("import sys; sys.exit(0)", "SystemExit: 0"),
        ("while True: pass", "nothing has come of it for 0.5 s, so it was ended; look for a loop without end"),
    ],
)
@pytest.mark.parametrize("at", ["import", "forward"])
def test_a_file_that_ends_its_process(
    at: str, code: str, said: str, work: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Status 1 and one line, when it is loaded and when it is run."""
    text = (ROOT / EXERCISES["split"].file).read_text(encoding="utf-8")
    line = "y.data[...] = bottom[0].data"
    assert line in text
    indented = f"exec({code!r})"
    text = f"{text}\n{code}\n" if at == "import" else text.replace(line, indented)
    (work / "split.py").write_text(text)
    assert command.main(["split", "--limit", "0.5"]) == 1
    out, err = capsys.readouterr()
    if "sys.exit" in code and at == "forward":  # it is caught where an error of this step would be
        assert said in out.splitlines()[-1] or said in out
        return
    assert err.startswith("split.py:") and said in err and err.count("\n") == 1


def test_closed_streams_are_no_obstacle(work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The reader's code may close its own."""
    text = (ROOT / EXERCISES["split"].file).read_text(encoding="utf-8")
    (work / "split.py").write_text(f"{text}\nimport sys\nsys.stdout.close()\nsys.stdin.close()\n")
    assert command.main(["split", "--iterations", "0"]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("All of it is right.")


def test_ctrl_c_ends_a_loop_without_end(work: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Status 130, in one word: what the reader's code does is the reader's."""
    text = (ROOT / EXERCISES["split"].file).read_text(encoding="utf-8")
    (work / "split.py").write_text(text.replace("y.data[...] = bottom[0].data", "raise KeyboardInterrupt"))
    assert command.main(["split"]) == 130
    assert capsys.readouterr().err == "interrupted\n"
