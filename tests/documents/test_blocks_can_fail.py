"""The harness itself, on small documents: incorrect blocks fail, and correct ones pass."""

from __future__ import annotations

import os
import select
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sybil", reason="sybil runs the blocks of documents: pip install -e '.[test]'")

from tests.documents import commands, workplace
from tests.documents.blocks import failures
from tests.documents.output import difference


@pytest.fixture
def reported(tmp_path: Path):
    """``reported(text)``: the failures of a document with this text."""
    folder = tmp_path / "project"
    python = workplace.furnish(folder)

    def run(text: str) -> list[str]:
        path = tmp_path / "document.md"
        path.write_text(text, encoding="utf-8")
        with workplace.at_work_in(folder):
            return list(failures(path, folder, python, {"given": 7}))

    return run


def block(tag: str, *lines: str) -> str:
    """Return a block as it is written in a document."""
    return "\n".join([f"```{tag}", *lines, "```", ""])


GOOD = {
    "numbers to the digits shown": block("pycon", ">>> import math", ">>> math.pi, 2e-7", "(3.14, 2e-07)"),
    "white space": block("pycon", ">>> import numpy as np", ">>> np.array([1.5, -2.25])", "array([1.5,  -2.25])"),
    "an error that is shown": block(
        "pycon", ">>> 1 / 0", "Traceback (most recent call last):", "ZeroDivisionError: division by zero"
    ),
    "one namespace": block("python", "x = given + 1") + block("pycon", ">>> x", "8"),
    "what a Python block prints": block("python", "print(1 / 3, 'done')") + "\n" + block("text", "0.333 done"),
    "an invisible block": "<!-- invisible-code-block: python\ny = 3\n-->\n\n" + block("pycon", ">>> y", "3"),
    "what commands print": block("bash", "echo 30 frames in 1.234 s, 12 frames/s", "echo rest 1>&2")
    + block("text", "30 frames in 1.23 s, … frames/s", "rest"),
    "a wildcard for lines": block("bash", "seq 5") + block("text", "1", "…", "5"),
    "the Python of the tests": block("bash", "python -c 'import sys, netlib; print(sys.prefix)'")
    + block("text", sys.prefix),
    "a reason": "<!-- not run: there is no camera -->\n"
    + block("bash", "python tools/record.py realsense --out takes/mine"),
    "a reason of two lines": "<!-- not run: there is\nno camera -->\n" + block("python", "raise ValueError"),
    "code of a file": "<!-- code: netlib/blob.py Blob -->\n" + block("python", "raise ValueError"),
    "JavaScript of a file": "<!-- code: docs/page.js -->\n" + block("js", "const x = 3"),
    "a file": "<!-- file: hello.py -->\n"
    + block("python", "import sys", "print(sys.argv[1])")
    + block("bash", "python hello.py you")
    + block("text", "you"),
    "a Python module": "<!-- file: mine.py -->\n"
    + block("python", "z = 4")
    + block("pycon", ">>> import mine", ">>> mine.z", "4"),
    "a net": block(
        "prototxt", 'layer { name: "r" type: "ReLU" bottom: "x" top: "x" relu_param { negative_slope: 0.1 } }'
    ),
    "an old net": block("prototxt", 'layers { name: "r" type: RELU bottom: "x" top: "x" }'),
    "a solver": block("prototxt", 'net: "net.prototxt" base_lr: 0.1 # a comment'),
    "a skeleton": block("prototxt", 'dof { name: "a" } joint { name: "b" rotate { axis: X dof: "a" } }'),
    "a piece of a skeleton": block("prototxt", 'joint { name: "b" parent: "c" bone { axis: X length: 1 } }'),
    "a message": block("prototxt", "dim: 1 dim: 3"),
    "options": block("prototxt", "inner_product_param { num_output: 2 }"),
    "options alone": block("prototxt", 'num_output: 2 weight_filler { type: "xavier" }'),
    "json": block("json", '{"rate": 30}'),
    "text": block("text", "x = y ²"),
    "a list": "- one\n\n    make more of it\n",
    "an indented formula": "So:\n\n    y = w x + b\n\n",
    "no output": block("pycon", ">>> x = 3", ">>> for i in range(2):", "...     x += i", ">>> x", "4"),
}

BAD = {
    "a wrong number": (block("pycon", ">>> 1 / 3", "0.35"), "line 2: 0.35 is shown, 0.3333333333333333 was printed"),
    "a wrong whole number": (block("pycon", ">>> 1 + 2", "4"), "line 2: shown and printed differ"),
    "a float that is whole": (
        block("pycon", ">>> import numpy as np", ">>> np.array([0.0, 1.0])", "array([1., 0.])"),
        "line 3: 1.",
    ),
    "an output that is not shown": (block("pycon", ">>> 3"), "shown and printed differ"),
    "an output that says nothing": (block("pycon", ">>> 3", "…"), "an output of … alone compares nothing"),
    "no prompt": (block("pycon", "3"), "a pycon block begins with >>>"),
    "an error in pycon": (block("pycon", ">>> 1 / 0"), "ZeroDivisionError"),
    "an error": (block("python", "x = 1", "raise ValueError('no')"), "line 1: in line 3\nValueError: no"),
    "a name of nowhere": (block("python", "print(nothing)"), "NameError: name 'nothing' is not defined"),
    "a syntax error": (block("python", "x ="), "SyntaxError"),
    "a syntax error, not run": ("<!-- not run: slow -->\n" + block("python", "x ="), "SyntaxError"),
    "an end": (block("python", "import sys", "sys.exit(0)"), "SystemExit: 0"),
    "a package of nowhere": (block("python", "import no_such_package"), "ModuleNotFoundError"),
    "what a Python block prints": (
        block("python", "print(1)") + "\n" + block("text", "2"),
        "line 5: shown and printed differ",
    ),
    "an error in an invisible block": (
        "<!-- invisible-code-block: python\nraise ValueError('no')\n-->\n",
        "ValueError: no",
    ),
    "an invisible block of nobody": (
        "<!-- invisible-code-block: bash\nfalse\n-->\n",
        "an invisible block of 'bash' is not run",
    ),
    "no tag": (block("", "x"), "a block without a tag"),
    "an unknown tag": (block("pyhton", "x"), "a block of 'pyhton': expected one of pycon, python"),
    "JavaScript of nobody": (block("js", "const x = 3"), "a block of 'js'"),
    "a tag and more": (block("python title=x", "x"), "a block of 'python title=x'"),
    "no end": ("```text\nx\n", "no fence ends this block"),
    "an indented command": ("So:\n\n    python tools/gone.py\n\n", "line 3: code that is only indented"),
    "an indented prompt": ("So:\n\n    >>> 1\n\n", "line 3: code that is only indented"),
    "no reason": ("<!-- not run: -->\n" + block("python", "1 / 0"), "'not run' above this block says nothing"),
    "no reason at all": ("<!-- not run -->\n" + block("python", "1 / 0"), "'not run' above this block says nothing"),
    "a reason of no block": (
        "<!-- not run: slow -->\n\n" + block("text", "x"),
        "line 1: 'not run' stands directly above no block",
    ),
    "a file that nobody uses": (
        "<!-- file: mine.py -->\n" + block("python", "1"),
        "no later block uses the file mine.py",
    ),
    "a command that fails": (block("bash", "echo before", "false", "echo after"), "line 1: exit status 1:\nbefore"),
    "the first of a pipe that fails": (block("bash", "false | true"), "exit status 1"),
    "another output": (block("bash", "echo 0.5 s") + block("text", "0.7 s"), "line 4: 0.7 is shown, 0.5 was printed"),
    "a tool that is gone": (block("bash", "python tools/gone.py"), "there is no tools.gone"),
    "an option that is gone": (
        block("bash", "python tools/train.py solver.prototxt --gone 3"),
        "unrecognized arguments: --gone 3",
    ),
    "an option that is gone, not run": (
        "<!-- not run: slow -->\n" + block("bash", "python tools/train.py a --gone"),
        "--gone",
    ),
    "a value that is none": (block("bash", "python tools/demo.py --frames many"), "argument --frames: expected"),
    "too few arguments": (
        block("bash", "NETLIB_ENGINE=plain python tools/predict.py >log 2>&1"),
        "the following arguments are required",
    ),
    "an option behind a pipe": (block("bash", "true && cat x | python tools/train.py a --gone"), "--gone"),
    "an option in the next line": (block("bash", "python tools/train.py a \\", "  --gone"), "--gone"),
    "a target that is gone": (
        "<!-- not run: slow -->\n" + block("bash", "make gone ITERATIONS=3"),
        "no target gone in the Makefile",
    ),
    "an extra that is gone": (
        "<!-- not run: network -->\n" + block("bash", "pip install -e '.[video,gone]'"),
        "no extra gone",
    ),
    "a module that is gone": (
        "<!-- not run: slow -->\n" + block("bash", "python -m tests.support.gone"),
        "there is no tests.support.gone",
    ),
    "an option of a module": (
        "<!-- not run: slow -->\n" + block("bash", "python -m tests.support.random_programs --gone"),
        "--gone",
    ),
    "a script that is gone": (block("bash", "python mine.py"), "there is no mine.py"),
    "a quotation without end": (block("bash", "echo 'x"), "no shell can read this"),
    "another field": (block("prototxt", 'layer { name: "r" type: "ReLU" botom: "x" }'), "did you mean 'bottom'"),
    "another option": (block("prototxt", 'layer { type: "ReLU" relu_param { slope: 1 } }'), "unknown field 'slope'"),
    "another type": (block("prototxt", 'layer { type: "Rely" }'), "unknown layer type 'Rely'"),
    "a field of no solver": (block("prototxt", 'net: "a" base_rate: 1'), "base_rate"),
    "a DoF of nowhere": (
        block("prototxt", 'dof { name: "a" } dof { name: "a" } joint { name: "b" rotate { axis: X dof: "a" } }'),
        "'a'",
    ),
    "half a net": (block("prototxt", 'layer { name: "r"'), "the block:2:1: error"),
    "an empty net": (block("prototxt", "# nothing"), "nothing in it"),
    "half of json": (block("json", '{"rate": '), "Expecting value"),
}


@pytest.mark.parametrize("name", GOOD)
def test_good(name: str, reported) -> None:
    """A correct block passes."""
    assert reported(GOOD[name]) == []


@pytest.mark.parametrize("name", BAD)
def test_bad(name: str, reported) -> None:
    """An incorrect block gives one failure, with its line and the reason."""
    (failure,) = reported(BAD[name][0])
    assert failure.startswith("line ")
    assert BAD[name][1] in failure


@pytest.mark.parametrize("text", [block("python", "import lmdb"), block("pycon", ">>> import lmdb")])
def test_an_optional_package(text: str, reported, monkeypatch: pytest.MonkeyPatch) -> None:
    """A missing optional package raises ModuleNotFoundError, for which the test of the document is skipped."""
    monkeypatch.setitem(sys.modules, "lmdb", None)
    with pytest.raises(ModuleNotFoundError):
        reported(text)


def test_a_failure_hides_no_other(reported) -> None:
    """All failures of a document are reported, each with its own line."""
    text = block("python", "1 / 0") + "\n" + block("json", "{") + "\n" + block("pycon", ">>> 1", "2", ">>> 3", "4")
    assert [failure.split(":")[0] for failure in reported(text)] == ["line 1", "line 5", "line 10", "line 12"]


def test_nothing_of_a_document_stays(reported) -> None:
    """A document's imports, settings, environment variables and files affect neither later tests nor the project."""
    before = (
        Path.cwd(),
        dict(os.environ),
        list(sys.path),
        list(sys.meta_path),
        np.get_printoptions(),
        workplace.state(),
    )
    drawn, modules = np.random.get_state()[1].copy(), set(sys.modules)
    text = "<!-- file: mine.py -->\n" + block("python", "w = 1") + block(
        "python", "import os, sys, mine, netlib", "import numpy as np", "netlib.install_as_caffe()", "import caffe",
        "os.environ['MINE'] = '1'", "sys.path.append('x')", "np.set_printoptions(precision=2)", "np.random.seed(3)",
        "from pathlib import Path", "Path('prototxt/hand/nyu.prototxt').write_text('gone')",
        "os.remove('models/synthetic_hand/readme.md')",
    ) + block("bash", "echo gone > prototxt/nyu_solver.prototxt", "rm tools")
    assert reported(text) == []
    now = (Path.cwd(), dict(os.environ), list(sys.path), list(sys.meta_path), np.get_printoptions(), workplace.state())
    assert now == before
    assert not {"mine", "caffe"} & (set(sys.modules) - modules)
    assert (np.random.get_state()[1] == drawn).all()


def test_what_is_written_into_the_project_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Changed, new and removed files are detected."""
    monkeypatch.setattr(workplace, "ROOT", tmp_path)
    (tmp_path / "tools").mkdir()
    files = [tmp_path / "tools" / name for name in "abcd"]
    for file in files[:3]:
        file.write_text("whole")
    before = workplace.state()
    assert workplace.written(before) == []
    files[0].write_text("more than before")
    files[1].unlink()
    files[3].write_text("new")
    assert workplace.written(before) == [str(files[n]) for n in (0, 1, 3)]


def test_commands_end(reported, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A block that takes too long fails."""
    monkeypatch.setattr(commands, "SECONDS", 0.2)
    os.mkfifo(tmp_path / "never")
    (failure,) = reported(block("bash", f"read x <{tmp_path}/never"))
    assert "took more than 0.2 s" in failure


def test_nothing_is_left_running(reported, tmp_path: Path) -> None:
    """A process that a block started in the background ends with the block."""
    for name in ("alive", "ready", "never"):
        os.mkfifo(tmp_path / name)
    alive = os.open(tmp_path / "alive", os.O_RDONLY | os.O_NONBLOCK)
    behind = "(exec 3>alive; echo >ready; read x <never) >/dev/null 2>&1 &"
    assert reported(block("bash", f"cd {tmp_path}", behind, "read x <ready")) == []
    assert select.select([alive], [], [], 60)[0], "it still runs"
    assert os.read(alive, 1) == b""  # the writing end is closed
    os.close(alive)


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("v1.2", "v1.3"),
        ("1.2.3", "1.2.4"),
        ("0.33", "0.35"),
        ("-0.5", "0.5"),
        ("1e-3", "3e-3"),
        ("12", "13"),
        ("1.", "2."),
        ("a … 0.5", "a 1 0.7"),
        ("[0.1, 0.2]", "[0.1]"),
        ("x", "x y"),
        ("", "x"),
        ("x", ""),
        ("1.50", "1.52"),
        ("…", "x"),
    ],
)
def test_differences(shown: str, printed: str) -> None:
    """Numbers that differ in the digits shown, and any other difference, are reported."""
    assert difference(shown, printed)


@pytest.mark.parametrize(
    ("shown", "printed"),
    [
        ("0.33", "0.3312"),
        ("0.33", "0.34"),
        ("-0.", "0."),
        ("[ 0.  -0.]", "[0. 0.]"),
        ("9.14 MB", "9.137 MB"),
        ("1.", "1.00001"),
        ("9.3e-07", "9.27e-07"),
        ("…, 3 s", "1\n2, 3 s"),
        ("(0.5)", "(0.50001)"),
        ("1.5s", "1.52s"),
        ("", ""),
        ("±0.3", "±0.31"),
    ],
)
def test_agreements(shown: str, printed: str) -> None:
    """Numbers that agree in the digits shown are accepted."""
    assert difference(shown, printed) == ""
