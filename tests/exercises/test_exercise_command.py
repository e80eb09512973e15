"""The command lists, starts and checks exercises, and ends with one line whatever a
solution does.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from exercises.stubs import stub
from exercises.table import EXERCISES
from tests.support.running import ROOT, Done, run_python, run_tool

FORWARD = "y.data[...] = bottom[0].data"


def write(first: str = "", forward: str = FORWARD) -> None:
    """Write a solution of split, with code that runs when it is loaded, and another
    body of forward.
    """
    text = EXERCISES["split"].source()
    assert FORWARD in text
    Path("split.py").write_text(
        f"{text.replace(FORWARD, f'exec({forward!r})')}\n{first}\n", encoding="utf-8"
    )


def check(here: Path, *words: str, status: int = 0) -> Done:
    return run_python(ROOT / "tools" / "exercise.py", "split", *words, status=status, cwd=here)


def test_the_list_marks_what_is_started(here: Path) -> None:
    run_tool("exercise inner_product --start")
    lines = run_tool("exercise").out.splitlines()
    assert [line[5:].split()[0] for line in lines[:-1]] == list(EXERCISES)
    assert [line[0] for line in lines[:3]] == [" ", "·", " "]
    assert lines[-1] == "Start one: python tools/exercise.py relu --start"


def test_start_keeps_a_file(here: Path) -> None:
    assert run_tool("exercise relu --start").out.startswith("wrote relu.py: ")
    assert Path("relu.py").read_text(encoding="utf-8") == stub(
        EXERCISES["relu"], "python tools/exercise.py"
    )
    Path("relu.py").write_text("mine")
    done = run_tool("exercise relu --start", status=1)
    assert done.err == "relu.py: already exists and is kept; remove it to start again\n"
    assert Path("relu.py").read_text() == "mine"


def test_a_solution_passes(here: Path) -> None:
    write("print('x' * 100_000)", f"print('in forward'); {FORWARD}")
    done = check(here, "--iterations", "2")
    lines = done.out.splitlines()
    assert lines[0] == "Split: one blob for several readers (split.py)"
    assert [line[0] for line in lines[1:-1]] == ["✓"] * 5
    assert (
        lines[-1]
        == "Everything is correct. For comparison, the project's file: layers/common/split.py"
    )
    assert "in forward" in done.err


def test_a_bug_to_find(here: Path) -> None:
    run_tool("exercise split --bug 1")
    run_tool("exercise split --bug 1", status=1)
    lines = check(here, "--file", "split_bug1.py", status=1).out.splitlines()
    assert lines[2].startswith("✓ values")
    assert lines[3].startswith("✗ gradient")
    assert all(line.startswith("    ") and len(line) <= 120 for line in lines[4:])
    assert "dx contains only the gradient of the last top" in " ".join(lines)
    assert lines[-1].startswith("    See backward, split_bug1.py:")
    text = Path("split_bug1.py").read_text(encoding="utf-8")
    Path("split_bug1.py").write_text(
        text.replace("bottom[0].diff[...] = y.diff", "bottom[0].diff[...] += y.diff")
    )
    check(here, "--file", "split_bug1.py", "--iterations", "0")


@pytest.mark.parametrize(
    ("first", "said"),
    [
        (
            "import os; os._exit(0)",
            "split.py: the check ended with status 0: the code crashed, or ended the process\n",
        ),
        (
            "import os; os.abort()",
            "split.py: the check ended with signal SIGABRT: the code crashed, or ended the",
        ),
        ("import sys; sys.exit(0)", "(import sys; sys.exit(0)): SystemExit: 0\n"),
        ("def f(:", ": invalid syntax\n"),
        ("del Split", "split.py: Split missing; keep the names of the stub that --start writes\n"),
    ],
)
def test_a_solution_that_ends_the_check(first: str, said: str, here: Path) -> None:
    write(first)
    done = check(here, status=1)
    assert said in done.err
    assert done.err.count("\n") == 1
    assert done.out.count("\n") == 1


def test_an_endless_loop_ends_at_the_limit(here: Path) -> None:
    write("while True: pass")
    assert check(here, "--limit", "0.01", status=1).err.startswith(
        "split.py: not finished after 0.01 s; look for an"
    )


@pytest.mark.parametrize(
    ("argv", "status", "said"),
    [
        (
            ["relu"],
            1,
            "relu.py: not found; run python tools/exercise.py relu --start to create it\n",
        ),
        (["relu", "--file", "mine.py"], 1, "mine.py: not found\n"),
        (["split", "--bug", "9"], 1, "--bug 9: split has bugs 1 to 5\n"),
        (["relo"], 2, "unknown exercise 'relo' (did you mean 'relu'?); known: relu, inner_product"),
        (["--start"], 2, "--start, --bug and --file need the NAME of an exercise"),
        (["relu", "--bug", "1", "--start"], 2, "not allowed with argument"),
    ],
)
def test_wrong_usage(argv: list[str], status: int, said: str, here: Path) -> None:
    assert said in run_tool("exercise", *argv, status=status).err
