"""Every command that the Makefile, documents, help texts and messages name is run, or at least parsed.

The Makefile's targets run here in their smallest form, with all their lines. Blocks of documents are run by
test_blocks.py. Commands in running text, in docstrings and in messages are parsed by the programs' own parsers; every
program is run by its own tests.
"""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

from tests.support.source_imports import imports

pytest.importorskip("sybil", reason="tests of documents need sybil: pip install -e '.[test]'")

from tests.documents import commands, given, workplace
from tests.documents.test_blocks import DOCUMENTS
from tests.documents.workplace import CODE

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
FEW_FRAMES = "FRAMES='--train 16 --test 16 --workers 1'"
OF_A_BODY = ("data/{0}/frames.png", "snapshots/{0}.png", "snapshots/{0}_curves.png")


@dataclass(frozen=True)
class Run:
    """The smallest form of a target.

    variables  that make it small
    prints     part of the target's output
    writes     files that the target leaves behind
    needs      packages without which the test is skipped
    table      of the README: the target prints one with its columns and units, and other figures
    """

    variables: str = ""
    prints: str = ""
    writes: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    table: str = ""


def readme_table() -> str:
    """Return the output of ``make train`` that the README shows."""
    found = re.search(r"^\d+ frames \(synthetic\),.*\nsnapshot .*\n.*$", README, re.MULTILINE)
    assert found is not None
    return found[0]


RUN = {
    "help": Run(prints="make lint    the style and type checks"),
    "demo": Run("OPTIONS='--frames 1'", "For your own camera: ", ("demo/frame_0.png", "demo/hands.png")),
    "train": Run(
        f"ITERATIONS=1 {FEW_FRAMES}",
        "Train on from here: .venv/bin/python tools/train.py prototxt/nyu_solver.prototxt --snapshot "
        "snapshots/nyu_iter_1.solverstate.h5",
        ("snapshots/hands.png", "snapshots/curves.png", "snapshots/nyu_iter_1.solverstate.h5"),
        ("matplotlib",),
        readme_table(),
    ),
    **{
        body: Run(
            f"ITERATIONS=1 {FEW_FRAMES}",
            f"Pictures: data/{body}/frames.png",
            tuple(name.format(body) for name in OF_A_BODY),
            ("matplotlib",),
        )
        for body in ("person", "arm")
    },
    "table1": Run("OPTIONS=--list", "one_hand"),
    "faults": Run("CASES=1 SEED=1 ONLY=camera.json", "camera.json: 1 "),
    "docs": Run("OPTIONS='--check documents'"),  # the other parts are compared by tests/docs/test_made.py
}
# Only the commands of these targets are parsed.
NOT_RUN = {
    **{
        name: f"tests/benchmarks runs benchmarks/{name}.py in its smallest form" for name in ("bench", "parts", "ranks")
    },
    "book": "tests/docs/test_notebooks.py makes the notebooks by the same program and runs them",
    "test": "it runs these tests",
    "kernels": "it runs a part of these tests, and .ci/run runs it",
    "site": "minutes; tests/docs/site/test_site.py makes a part of the site by the same command and follows its links",
    "lint": ".ci/run runs it; its programs are in the extra dev, which the tests do without",
    "clean": "it removes the environment that runs these tests",
}


def test_every_target_is_run_or_says_why_not() -> None:
    """Every target is in one of the two tables, and in the help that ``make`` prints."""
    (phony,) = re.findall(r"^\.PHONY: (.*)$", MAKEFILE, re.MULTILINE)
    assert sorted([*RUN, *NOT_RUN]) == sorted(phony.split())
    helped = set(re.findall(r"^# make (\w+)|make (\w+): for", MAKEFILE, re.MULTILINE))
    assert {name for pair in helped for name in pair if name} >= set(phony.split()) - {"help", "clean"}
    assert "make lint" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A copy of the project in a folder with a space in its name, with environments; and the folder of ``python``."""
    folder = tmp_path_factory.mktemp("make") / "the project"
    python = workplace.furnish(folder)
    given.small_batches(folder)
    (folder / ".venv").mkdir()
    (folder / ".venv" / "bin").symlink_to(python)
    for name in commands.targets():
        if name.startswith(".venv/"):
            (folder / name).touch()  # newer than setup.cfg: nothing is installed
    return folder, python


def without_figures(text: str) -> str:
    """Return the text with # for numbers, also where a document leaves out digits."""
    return re.sub(r"\s+", " ", re.sub(r"[\d.…]+(e-?\d+)?", "#", text))


@pytest.mark.parametrize("target", RUN)
def test_a_target_runs(target: str, project: tuple[Path, Path]) -> None:
    """Every line of a target runs in its smallest form, and writes nothing into the project itself."""
    run = RUN[target]
    for package in run.needs:
        if find_spec(package) is None:
            pytest.skip(f"make {target} needs the package {package}, which is not there")
    folder, python = project
    before = workplace.state()
    printed = commands.run(f"make {target} {run.variables}", folder, python)
    assert run.prints in printed
    assert without_figures(run.table) in without_figures(printed)
    assert [name for name in run.writes if not (folder / name).is_file()] == []
    assert not workplace.written(before)


@pytest.mark.parametrize("command", [*RUN, *NOT_RUN, "table1 HOURS=8", "faults SEED=7 ONLY=resume", "site SERVE=1"])
def test_the_lines_of_a_target_parse(command: str, project: tuple[Path, Path]) -> None:
    """The lines of a target parse, also with variables that the Makefile names: programs, options and extras exist."""
    folder, python = project
    lines = commands.run(f"make --dry-run {command}", folder, python)
    assert lines.strip()
    assert list(commands.mistakes(lines, folder)) == []


def test_the_environments_are_extras(project: tuple[Path, Path]) -> None:
    """Each environment of the Makefile is an extra of setup.cfg, installed by a command that names it."""
    folder, python = project
    environments = sorted(name for name in commands.targets() if name.startswith(".venv/"))
    assert environments
    for name in environments:
        lines = commands.run(f"make --dry-run --always-make {name}", folder, python)
        assert f"-e '.[{name.removeprefix('.venv/')}]'" in lines
        assert list(commands.mistakes(lines, folder)) == []


_SPAN = re.compile(
    r"(`+)((?:(?:make|python|mpiexec|pip|tools/\w+\.py|benchmarks/\w+\.py) |(?:netlib|handpose) (?=[a-z]))[^`]*)\1"
)
_PROGRAM = re.compile(
    r"((?:mpiexec [^`#'\"]*? )?\bpython (?:tools/|benchmarks/|-m \w)[^`]*?)(?='?$|`|\s{2,}|\s+#|', |' or |, or )"
)
_MAKE = re.compile(r"(?:^ {4}|``)(make \w+)(?=$|``| {2,})")
_UNFINISHED = ("arguments are required", "expected one argument", "train needs -solver")


def in_document(path: Path) -> list[str]:
    """Return the commands in backticks in a document's text and tables, without those of the reader's own files."""
    text = path.read_text(encoding="utf-8")
    own = re.findall(r"<!-- file: (\S+\.py) -->", text)
    text = re.sub(r"^[ \t]*(`{3,}).*?^[ \t]*\1", "", text, flags=re.DOTALL | re.MULTILINE)
    found = [" ".join(match[2].split()) for match in _SPAN.finditer(text)]
    return [command for command in found if not set(own) & set(command.split())]


@cache
def in_source(path: Path) -> list[str]:
    """Return the commands in the strings of a Python file: docstrings, which are help texts, and messages."""
    found: list[str] = []
    text = path.read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(text)) if "python " in text or "make " in text else ():
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            for line in node.value.replace("\\\n", " ").splitlines():
                found += [match[1] for match in [*_PROGRAM.finditer(line), *_MAKE.finditer(line)]]
    return found


def mistake(command: str) -> str:
    """Return the error of a command, which may be abbreviated with "..." or lack its files."""
    command = re.split(r" ?(?:\.{3}|…)", command)[0].rstrip(" .,;:")
    command = re.sub(r"^((?:tools|benchmarks)/)", r"python \1", command)
    found = commands.mistakes(command, ROOT)
    return "\n".join(line for line in found if not any(words in line for words in _UNFINISHED))


def test_commands_in_running_text_parse() -> None:
    """The commands in the text of every document but the changelog, which names old ones, are correct."""
    found = {path: in_document(path) for path in DOCUMENTS if path.name != "CHANGELOG.md"}
    assert "make bench" in found[ROOT / "docs" / "speed.md"]
    assert {path.name: wrong for path in found for command in found[path] if (wrong := mistake(command))} == {}


def test_commands_in_help_texts_and_messages_parse() -> None:
    """The commands in the strings of every source file but the tests are correct."""
    tops = (*CODE, "tests/faults", "tests/support")
    found = {path: in_source(path) for top in tops for path in (ROOT / top).rglob("*.py")}
    bench = found[ROOT / "benchmarks" / "bench.py"]
    assert {"make bench", "python benchmarks/bench.py --json speed.json"} <= set(bench)
    assert "mpiexec -n 4 python -m mpi4py tools/train.py SOLVER" in found[ROOT / "netlib" / "distributed" / "mpi.py"]
    assert {path.name: wrong for path in found for command in found[path] if (wrong := mistake(command))} == {}


@pytest.mark.parametrize(
    ("command", "what"),
    [
        ("make gone", "no target gone in the Makefile"),
        ("python benchmarks/bench.py --gone", "unrecognized arguments: --gone"),
        ("mpiexec -n 4 python -m mpi4py tools/train.py SOLVER --gone", "unrecognized arguments: --gone"),
        ("tools/gone.py", "there is no tools.gone"),
        ("netlib gone", "no command gone"),
        ("netlib test train_val.prototxt net.caffemodel --iterations 3", ""),
        ("handpose predict frame.png --gone", "unrecognized arguments: --gone"),
        ("python -m tests.faults.campaign --cases many", "--cases"),
        ("tools/test.py --model NET --joints", ""),
        ("mpiexec -n 4 -ppn 1 python -m mpi4py ...", ""),
        ("tools/caffe.py train ... is what it was", ""),
    ],
)
def test_a_mistake_is_found(command: str, what: str) -> None:
    """Removed programs, targets and options are reported; omitted arguments are not."""
    assert (what in mistake(command)) and bool(mistake(command)) == bool(what)


# The test that runs each program; that of tools/NAME.py is tests/tools/test_NAME.py unless it is named here.
RUN_BY = {
    "benchmarks.ablation": "tests/benchmarks/test_ablation.py",
    "benchmarks.bench": "tests/benchmarks/test_bench.py",
    "benchmarks.fit": "tests/benchmarks/test_fit_benchmark.py",
    "benchmarks.nets": "tests/benchmarks/test_nets_benchmark.py",
    "benchmarks.ranks": "tests/benchmarks/test_ranks_benchmark.py",
    "benchmarks.parts": "tests/benchmarks/test_bench_parts.py",
    "docs.book.nano": "tests/docs/test_nano.py",
    "experiments.confidence": "tests/experiments/test_confidence.py",
    "docs.making": "tests/docs/test_made.py",
    "docs.making.five_minutes": "tests/docs/test_five_minutes.py",
    "docs.making.hand_picture": "tests/docs/test_pages.py",
    "docs.making.live_picture": "tests/docs/test_page_picture.py",
    "docs.making.notebooks": "tests/docs/test_notebooks.py",
    "handpose": "tests/handpose/test_main.py",
    "netlib.caffe": "tests/netlib/test_install.py",
    "tests.caffe.reduce": "tests/caffe/test_caffe_whole.py",
    "tests.exercises.reduce_recordings": "tests/exercises/test_exercises.py",
    "tests.faults.campaign": "tests/documents/test_commands.py",  # make faults
    "tests.handpose.estimate.moved_frames": "tests/handpose/estimate/test_processors.py",
    "tests.support.random_programs": "tests/fast/test_random_programs.py",
    "tests.support.rank_programs": "tests/netlib/distributed/test_mpi.py",
    "tools.exercise": "tests/exercises/test_exercise_command.py",
    "tools.export_onnx": "tests/export/onnx/test_export_onnx.py",
    "tools.measure_fit": "tests/tools/test_package_model.py",
}
# Text in the tests of programs that are not imported by name with a call of their ``main``.
BY_COMMAND = {
    "benchmarks.parts": 'pytest.importorskip("benchmarks.parts")',
    "docs.book.nano": "COMMAND",
    "docs.making.five_minutes": "run_tool(TOOL, ",
    "handpose": '"-m", "handpose"',
    "netlib.caffe": '"-m", "netlib.caffe"',
    "tests.caffe.reduce": "reduce.main(",
    "tests.faults.campaign": '"faults": Run(',
    "tests.support.rank_programs": "run(4, PROGRAMS, ",
}


def program(words: list[str]) -> str:
    """Return the module of this project that a command runs as a program, or an empty string."""
    while words and (commands._PYTHON.fullmatch(words[0]) or words[0] in ("-m", "mpi4py")):
        words = words[1:]
    at = next((at for at, word in enumerate(words) if commands._PYTHON.fullmatch(word)), None)
    if words[:1] == ["mpiexec"] and at is not None:
        return program(words[at:])
    name = words[0].removesuffix(".py").replace("/", ".") if words else ""
    path = ROOT.joinpath(*name.split("."))
    is_program = path.parent.joinpath(f"{path.name}.py").is_file() or (path / "__main__.py").is_file()
    return name if name and is_program else ""


def named_programs() -> set[str]:
    """Return the programs named by documents, the Makefile, help texts and messages, and every tool."""
    texts = {MAKEFILE.replace("$(RUN)", "python")}
    for path in DOCUMENTS:
        if path.name != "CHANGELOG.md":
            texts |= set(in_document(path))
            texts |= set(re.findall(r"^```bash\n(.*?)^```", path.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE))
    for path in [path for top in (*CODE, "tests") for path in (ROOT / top).rglob("*.py")]:
        if path.name != "test_commands.py":  # its commands are wrong on purpose
            texts |= set(in_source(path))
    found = {f"tools.{path.stem}" for path in ROOT.glob("tools/*.py") if "def main(" in path.read_text("utf-8")}
    for text in texts:
        for line in text.replace("\\\n", " ").splitlines():
            for words in re.split(r"[;&|]| # ", line.strip()):
                found.add(program(words.split()))
    return found - {""}


def test_every_named_program_is_run_by_a_test() -> None:
    """The test of each named program imports and runs it, or starts it as BY_COMMAND requires."""
    named = named_programs()
    assert {"tools.train", "netlib.caffe", "tests.faults.campaign", "docs.making", "benchmarks.ranks"} <= named
    for name in sorted(named):
        path = ROOT / RUN_BY.get(name, f"tests/tools/test_{name.rpartition('.')[2]}.py")
        assert name in RUN_BY or (name.startswith("tools.") and path.is_file()), f"no test runs {name}"
        text = path.read_text(encoding="utf-8")
        if name in BY_COMMAND:
            assert BY_COMMAND[name] in text, name
        elif not re.search(rf'run_tool\(\s*"({name}|{name.removeprefix("tools.")})(\.__main__)?"', text):
            assert re.search(r"\bmain\(", text), f"{path} does not run {name}"
            assert any(other.startswith(name) for other in imports(path)), f"{path} does not import {name}"
    assert set(RUN_BY) <= named, "programs that no document names"
    assert set(BY_COMMAND) <= set(RUN_BY)
