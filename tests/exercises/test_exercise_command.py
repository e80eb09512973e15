"""The command lists, starts and checks exercises, and reports errors in plain words."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from exercises.checking import steps
from exercises.reading import ReadersFile
from exercises.runner import LocalRunner
from exercises.stubs import bugs, stub
from exercises.table import EXERCISES
from tests.support.running import run_tool
from tests.tools.conftest import ROOT


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_list(work: Path) -> None:
    """The list has every exercise with its chapter, and how to start one."""
    lines = run_tool("exercise").out.splitlines()
    assert [line.split()[1] for line in lines[:-1]] == list(EXERCISES)  # no mark: none is started
    assert lines[-1] == "Start one: python tools/exercise.py relu --start"


@pytest.mark.parametrize("name", EXERCISES)
def test_start(name: str, work: Path) -> None:
    """``start`` writes the stub into the working folder and never overwrites a file."""
    done = run_tool("exercise", name, "--start")
    path = work / f"{name}.py"
    assert path.read_text(encoding="utf-8") == stub(EXERCISES[name])
    assert done.out.startswith(f"wrote {name}.py: ")
    path.write_text("mine")
    done = run_tool("exercise", name, "--start", status=1)
    assert done.err == f"{name}.py: already exists and is kept; remove it to start again\n"
    assert path.read_text() == "mine"


def test_a_solution(work: Path) -> None:
    """A correct solution gets a tick for each step and the path of the project's own source."""
    (work / "split.py").write_text((ROOT / EXERCISES["split"].file).read_text(encoding="utf-8"))
    lines = run_tool("exercise", "split", "--iterations", "2").out.splitlines()
    assert lines[0] == "Split: one blob for several consumers (split.py)"
    assert [line[0] for line in lines[1:-1]] == ["✓"] * 5
    assert lines[-1] == "Everything is correct. For comparison, the project's file: layers/common/split.py"


def test_the_list_shows_progress(work: Path) -> None:
    """The list has a tick for a file that has passed unchanged, and a point for one started or changed since."""
    text = (ROOT / EXERCISES["split"].file).read_text(encoding="utf-8")
    (work / "split.py").write_text(text)
    run_tool("exercise", "relu", "--start")
    run_tool("exercise", "split", "--iterations", "0")
    for after, mark in ((text, "✓"), (text + "# changed", "·")):
        (work / "split.py").write_text(after)
        lines = run_tool("exercise").out.splitlines()
        assert [line[0] for line in lines[:5]] == ["·", " ", " ", " ", mark]
    (work / ".exercises.json").write_text("[")
    run_tool("exercise")


def test_bare(work: Path) -> None:
    """--bare writes the names of the blobs and the signatures, without formulas or hints."""
    run_tool("exercise", "relu", "--start", "--bare")
    text = (work / "relu.py").read_text(encoding="utf-8")
    assert "bottom[0]" in text and "dx =" not in text and "self.slope * x" not in text
    assert text.count("raise NotImplementedError") == 3 and "# Give" not in text


def test_a_bug_to_find(work: Path) -> None:
    """A file with a planted bug is checked like a solution, and passes when the bug is fixed."""
    run_tool("exercise", "sgd", "--bug", "1")
    run_tool("exercise", "sgd", "--bug", "1", status=1)
    text = (work / "sgd_bug1.py").read_text(encoding="utf-8")
    done = run_tool("exercise", "sgd", "--file", "sgd_bug1.py", status=1)
    assert "The rate is applied when w is changed" in " ".join(done.out.split())
    run_tool("exercise", "sgd", "--bug", "2")
    mended = text.replace("h[...] = p.momentum * h + g", "h[...] = p.momentum * h + rate * g", 1)
    (work / "sgd_bug1.py").write_text(mended.replace("w -= rate * h", "w -= h", 1))
    run_tool("exercise", "sgd", "--file", "sgd_bug1.py", "--iterations", "0")
    assert run_tool("exercise", "sgd", "--bug", "99", status=1).err == "--bug 99: sgd has bugs 1 to 15\n"
    assert run_tool("exercise", "resume", "--bug", "1", status=1).err == "--bug 1: resume has no bug to find\n"


@pytest.mark.parametrize("name", EXERCISES)
def test_every_bug_is_one(name: str, work: Path) -> None:
    """Each file with a planted bug can be read, and fails with the advice for its mistake."""
    exercise = EXERCISES[name]
    found = set()
    for text in bugs(exercise):
        (work / f"{name}.py").write_text(text)
        reader = ReadersFile(exercise, Path(f"{name}.py"))
        *_, step = steps(exercise, LocalRunner(exercise, reader.part, reader))
        said = [m.advice for m in exercise.mistakes if any(line.endswith(m.advice) for line in step.lines)]
        assert not step.passed and len(said) == 1
        found.add(said[0])
    assert len(found) == len(bugs(exercise))


def test_a_file_that_is_not_right(work: Path) -> None:
    """A wrong solution ends with status 1; the failed step comes last, and its lines fit on a screen."""
    text = (ROOT / EXERCISES["split"].file).read_text(encoding="utf-8")
    Path("mine.py").write_text(text.replace("bottom[0].diff[...] += y.diff", "bottom[0].diff[...] = y.diff"))
    lines = run_tool("exercise", "split", "--file", "mine.py", status=1).out.splitlines()
    failed = next(i for i, line in enumerate(lines) if line.startswith("✗"))
    assert lines[failed - 1].startswith("✓ values")
    rest = lines[failed + 1 :]
    assert all(line.startswith("    ") and len(line) <= 120 for line in rest)
    assert "dx contains only the gradient of the last top" in " ".join(rest)
    assert rest[-1].startswith("    See Split.backward, mine.py:")


def test_the_file_here_is_checked(work: Path) -> None:
    """The file in the working folder is checked; without one, the error says how to get it."""
    done = run_tool("exercise", "relu", status=1)
    assert done.err == "relu.py: not found; run python tools/exercise.py relu --start to create it\n"
    (work / "relu.py").write_text("x = 1\n")
    assert run_tool("exercise", "relu", status=1).err.startswith("relu.py: ReLU.setup")


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["relo"], "unknown exercise 'relo' (did you mean 'relu'?); known: relu, inner_product"),
        (["--start"], "--start, --bug and --file need the NAME of an exercise"),
        (["relu", "--bare"], "--bare needs --start"),
        (["relu", "--bug", "0"], "expected"),
        (["relu", "--bug", "1", "--start"], "--bug writes NAME_bugN.py"),
        (["EuclideanLoss"], "(did you mean 'euclidean_loss'?)"),
        (["--file", ""], "--start, --bug and --file need the NAME of an exercise"),
        (["--file", "relu.py"], "--start, --bug and --file need the NAME of an exercise"),
        (["relu", "--start", "--file", "mine.py"], "--start writes NAME.py; use --file to check it"),
        (["relu", "--iterations", "-1"], "expected an integer"),
    ],
)
def test_wrong_usage(argv: list[str], said: str, work: Path) -> None:
    """Wrong usage ends with status 2 and a line that helps."""
    assert said in run_tool("exercise", *argv, status=2).err


@pytest.mark.parametrize("kind", ["pipe", "folder", "device", "link to nothing", "large", "unreadable"])
def test_the_list_with_other_things_than_files(kind: str, work: Path) -> None:
    """A pipe, a folder, a device or a large file in the place of a solution or of the record is no solution."""
    for path in (work / "relu.py", work / ".exercises.json"):
        if kind == "pipe":
            os.mkfifo(path)
        elif kind == "folder":
            path.mkdir()
        elif kind in ("device", "link to nothing"):
            path.symlink_to("/dev/zero" if kind == "device" else "nothing")
        else:
            path.touch(0o600 if kind == "large" else 0)
            os.truncate(path, 1 << 40 if kind == "large" else 0)
    expected = "·" if kind in ("large", "unreadable") else " "
    assert [line[0] for line in run_tool("exercise").out.splitlines()[:3]] == [expected, " ", " "]
    done = run_tool("exercise", "relu", "--file", "relu.py", status=1)
    assert done.err.startswith("relu.py: ") and done.err.count("\n") == 1


def test_a_record_that_cannot_be_written(work: Path) -> None:
    """A solution passes even if that cannot be recorded."""
    (work / ".exercises.json").mkdir()
    (work / "split.py").write_text((ROOT / EXERCISES["split"].file).read_text(encoding="utf-8"))
    done = run_tool("exercise", "split", "--iterations", "0")
    assert done.err.startswith(".exercises.json: cannot be written") and done.err.count("\n") == 1
