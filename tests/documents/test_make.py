"""The Makefile's targets run in their smallest form, with all their lines."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.documents import commands, given, workplace

MAKEFILE = (Path(__file__).resolve().parents[2] / "Makefile").read_text(encoding="utf-8")
SMALL = "ITERATIONS=1 FRAMES='--train 16 --test 16 --workers 1'"
RUN = {  # target: variables that make it small, and a part of its output
    "help": ("", "make lint    the style and type checks"),
    "demo": ("OPTIONS='--frames 1'", "For your own camera: "),
    "train": (
        SMALL,
        "tools/train.py prototxt/nyu_solver.prototxt --snapshot snapshots/nyu_iter_1.solverstate.h5",
    ),
}
NOT_RUN = {
    "docs": "it writes documents; tests/docs/test_generated.py runs its programs",
    "test": "it runs these tests",
    "kernels": "a part of these tests; .ci/run runs it",
    "lint": ".ci/run runs it",
    "clean": "it removes .venv",
}


def test_every_target_is_run_or_says_why_not() -> None:
    (phony,) = re.findall(r"^\.PHONY: (.*)$", MAKEFILE, re.MULTILINE)
    assert sorted([*RUN, *NOT_RUN]) == sorted(phony.split())


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project in a folder with a space in its name, with environments in which
    nothing is missing.
    """
    folder = tmp_path_factory.mktemp("make") / "the project"
    workplace.furnish(folder)
    given.small_batches(folder)
    for name in commands.targets():
        if name.startswith(".venv/"):
            (folder / name).touch()  # newer than setup.cfg: nothing is installed
    return folder


@pytest.mark.parametrize("target", RUN)
def test_a_target_runs(target: str, project: Path) -> None:
    pytest.importorskip("matplotlib")
    variables, printed = RUN[target]
    assert printed in commands.run(f"make {target} {variables}", project)


@pytest.mark.parametrize("target", [*NOT_RUN, "docs SERVE=1"])
def test_programs_of_a_target_accept_their_arguments(target: str, project: Path) -> None:
    lines = commands.run(f"make --dry-run {target}", project)
    assert lines.strip() and list(commands.mistakes(lines)) == []
