"""The Makefile's targets run in their smallest form, with all their lines."""

from __future__ import annotations

import re
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.documents import commands, given, workplace

ROOT = Path(__file__).resolve().parents[2]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
SMALL = "ITERATIONS=1 FRAMES='--train 16 --test 16 --workers 1'"


class Run(NamedTuple):
    """Variables that make a target small, part of its output, files that it writes, and a package that it needs."""

    variables: str = ""
    prints: str = ""
    writes: tuple[str, ...] = ()
    needs: str = ""


RUN = {
    "help": Run(prints="make lint    the style and type checks"),
    "demo": Run("OPTIONS='--frames 1'", "For your own camera: ", ("demo/frame_0.png", "demo/hands.png")),
    "train": Run(SMALL, "tools/train.py prototxt/nyu_solver.prototxt --snapshot snapshots/nyu_iter_1.solverstate.h5",
                 ("snapshots/hands.png", "snapshots/curves.png", "snapshots/nyu_iter_1.solverstate.h5"), "matplotlib"),
    "person": Run(SMALL, "Pictures: data/person/frames.png", ("snapshots/person_curves.png",), "matplotlib"),
    "arm": Run(SMALL, "Pictures: data/arm/frames.png", ("snapshots/arm_curves.png",), "matplotlib"),
    "table1": Run("OPTIONS=--list", "one_hand"),
    "faults": Run("CASES=1 SEED=1 ONLY=camera.json", "camera.json: 1 "),
}
NOT_RUN = {  # only the arguments of their programs are checked
    "bench": "by tests/benchmarks", "parts": "by tests/benchmarks", "ranks": "by tests/benchmarks",
    "docs": "it writes documents; tests/docs/test_generated.py runs its programs", "test": "it runs these tests",
    "kernels": "a part of these tests; .ci/run runs it", "lint": ".ci/run runs it", "clean": "it removes .venv",
}


def test_every_target_is_run_or_says_why_not() -> None:
    """Every target is in one of the two tables, and in the help that ``make`` prints."""
    (phony,) = re.findall(r"^\.PHONY: (.*)$", MAKEFILE, re.MULTILINE)
    assert sorted([*RUN, *NOT_RUN]) == sorted(phony.split())
    assert set(re.findall(r"make (\w+)", MAKEFILE)) >= set(phony.split()) - {"help", "clean"}


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project in a folder with a space in its name, with environments in which nothing is missing."""
    folder = tmp_path_factory.mktemp("make") / "the project"
    workplace.furnish(folder)
    given.small_batches(folder)
    for name in commands.targets():
        if name.startswith(".venv/"):
            (folder / name).touch()  # newer than setup.cfg: nothing is installed
    return folder


@pytest.mark.parametrize("target", RUN)
def test_a_target_runs(target: str, project: Path) -> None:
    """Every line of a target runs in its smallest form, and writes nothing into the project."""
    run = RUN[target]
    if run.needs and find_spec(run.needs) is None:
        pytest.skip(f"make {target} needs the package {run.needs}, which is not there")
    before = workplace.state()
    assert run.prints in commands.run(f"make {target} {run.variables}", project)
    assert [name for name in run.writes if not (project / name).is_file()] == []
    assert workplace.state() == before


@pytest.mark.parametrize("command", [*NOT_RUN, "table1 HOURS=8", "faults SEED=7 ONLY=resume", "docs SERVE=1"])
def test_the_programs_of_a_target_accept_their_arguments(command: str, project: Path) -> None:
    """The lines of a target parse, also with variables that the Makefile names."""
    lines = commands.run(f"make --dry-run {command}", project)
    assert lines.strip() and list(commands.mistakes(lines)) == []


def test_environments_are_extras(project: Path) -> None:
    """Each environment of the Makefile is an extra of setup.cfg, installed by a command that names it."""
    extras = (ROOT / "setup.cfg").read_text(encoding="utf-8").partition("[options.extras_require]")[2]
    for name in (name.removeprefix(".venv/") for name in commands.targets() if name.startswith(".venv/")):
        assert re.search(rf"^{name} =$", extras, re.MULTILINE)
        assert f"-e '.[{name}]'" in commands.run(f"make --dry-run --always-make .venv/{name}", project)
