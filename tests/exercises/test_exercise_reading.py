"""Errors in the reader's file are reported in a line or two, with the file and the line."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from exercises.checking import first_step, steps
from exercises.reading import ExerciseError, ReadersFile
from exercises.runner import LocalRunner
from exercises.stubs import stub
from exercises.table import EXERCISES
from tests.support.bad_input import bad_inputs

RELU = EXERCISES["relu"]
BODIES = {
    "reshape": "top[0].reshape(bottom[0].shape)",
    "forward": "top[0].data[...] = np.where(bottom[0].data > 0, 1, self.slope) * bottom[0].data",
    "backward": "bottom[0].diff[...] = np.where(bottom[0].data > 0, 1, self.slope) * top[0].diff",
}

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Write:
    """``write(forward="...")``: write a solution of relu to the working folder, with other bodies, or none (None)."""
    monkeypatch.chdir(tmp_path)

    def make(**bodies: str | None) -> Path:
        pieces = stub(RELU).split("        raise NotImplementedError\n")
        text = pieces[0]
        for piece, body in zip(pieces[1:], ({**BODIES, **bodies}).values()):
            text += f"        {body or 'raise NotImplementedError'}\n{piece}"
        Path("relu.py").write_text(text, encoding="utf-8")
        return Path("relu.py")

    return make


def failed(path: Path) -> list[str]:
    """Return the message of the step that fails."""
    reader = ReadersFile(RELU, path)
    *_, step = steps(RELU, LocalRunner(RELU, reader.part, reader))
    assert not step.passed
    return list(step.lines)


def test_a_solution_is_read(write: Write, monkeypatch: pytest.MonkeyPatch) -> None:
    """A correct file passes. No bytecode is written, because stale bytecode would hide later changes of the file."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    path = write()
    reader = ReadersFile(RELU, path)
    assert all(step.passed for step in steps(RELU, LocalRunner(RELU, reader.part, reader)))
    assert first_step(RELU, reader.outline).lines == ()
    assert [p.name for p in Path().iterdir()] == ["relu.py"]
    assert not sys.dont_write_bytecode


def test_a_file_that_was_changed_is_read_again(write: Write) -> None:
    """A changed file is read again at once."""
    assert failed(write(forward="top[0].data[...] = bottom[0].data"))
    reader = ReadersFile(RELU, write())
    assert all(step.passed for step in steps(RELU, LocalRunner(RELU, reader.part, reader)))


def test_one_method_after_the_other(write: Write) -> None:
    """Methods that are not yet written are listed, and only the step that needs them fails."""
    path = write(backward=None)
    line = path.read_text().splitlines().index("        raise NotImplementedError") + 1
    reader = ReadersFile(RELU, path)
    assert first_step(RELU, reader.outline).lines == (f"not yet written: ReLU.backward (line {line})",)
    made = list(steps(RELU, LocalRunner(RELU, reader.part, reader)))
    assert [step.passed for step in made] == [True, True, False]
    assert made[-1].lines == (f"ReLU.backward is not written yet: relu.py:{line} (raise NotImplementedError)",)


def test_what_nothing_asks_for_need_not_be_written(tmp_path: Path) -> None:
    """A function that the solution does not call, such as im2col, may stay unwritten."""
    path = tmp_path / "convolution.py"
    path.write_text(stub(EXERCISES["convolution"]), encoding="utf-8")
    reader = ReadersFile(EXERCISES["convolution"], path)
    assert "Convolution.im2col" in reader.outline.to_do
    assert reader.outline.needed == {"Convolution._outputs", "Convolution.forward", "Convolution.backward"}


def test_an_error_in_the_code_is_told_with_its_line(write: Write) -> None:
    """An error in the reader's code is reported with its line and without a traceback of the project's code."""
    path = write(forward="top[0].data[...] = x")
    line = path.read_text().splitlines().index("        top[0].data[...] = x") + 1
    first, second = failed(path)
    assert first == f"relu.py:{line} (top[0].data[...] = x): NameError: name 'x' is not defined"
    assert second == "The input was: bottom (2, 3, 4)."


def test_an_array_that_is_replaced(write: Write) -> None:
    """Replacing an array instead of writing into it, the most frequent first error, has its own message."""
    assert any("write into them, with [...] = on the left" in line for line in failed(write(forward="top[0].data = 0")))


def test_nothing_written(write: Write) -> None:
    """Making a new array does not count as writing the top."""
    assert "nothing was written" in failed(write(forward="y = np.maximum(bottom[0].data, 0)"))[1]


@pytest.mark.parametrize("how", ["raise SystemExit(3)", "sys.exit(3)", "exit()"])
def test_a_file_that_wants_to_end_the_program(how: str, write: Write) -> None:
    """A file that exits while it is loaded or run is reported as an error."""
    path = write(forward=f"import sys; {how}")
    assert "SystemExit" in failed(path)[0]
    path.write_text(f"import sys\n{how}\n")
    with pytest.raises(ExerciseError, match=r"^relu\.py:2 \(.*\): SystemExit"):
        ReadersFile(RELU, path)


KEEP = "missing; keep the names of the stub that --start writes"


@bad_inputs(ExerciseError, {
    "syntax": ("def f(:\n    pass\n", "relu.py:1: ...invalid syntax..."),
    "indent": ("x = 1\n    y = 2\n", "relu.py:2: ...unexpected indent..."),
    "attribute": ("import numpy as np\nnp.nothing\n", "relu.py:2 (np.nothing): AttributeError: ..."),
    "import": ("import nothing_like_it\n", "relu.py:1 (import nothing_like_it): ModuleNotFoundError: ..."),
    "no class": ("x = 1\n", f"relu.py: ReLU.setup, ReLU.reshape, ReLU.forward, ReLU.backward {KEEP}"),
    "one method": ("class ReLU:\n    def setup(self): pass\n",
                   f"relu.py: ReLU.reshape, ReLU.forward, ReLU.backward {KEEP}"),
    "no method": ("class ReLU:\n    forward = 1\n", f"relu.py: ReLU.setup, ReLU.reshape, ...{KEEP}"),
    "empty": ("", f"relu.py: ReLU.setup, ReLU.reshape, ReLU.forward, ReLU.backward {KEEP}"),
    "null": ("x = '\0'\n", "relu.py...: source code string cannot contain null bytes"),
    "late import": ("import os\nfrom __future__ import annotations\n",
                    "relu.py:2: from __future__ imports must occur at the beginning of the file"),
    "missing": (None, "relu.py: cannot read the exercise relu: No such file or directory"),
    "bytes": (b"\xff\xfe\x00", "relu.py: cannot read the exercise relu: not a text file (byte 0 is not UTF-8)"),
})
def test_a_file_that_is_no_solution(
    given: str | bytes | None, rejected: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that is not a solution gives one line with the file name and, if there is one, the line number."""
    monkeypatch.chdir(tmp_path)
    if given is not None:
        Path("relu.py").write_bytes(given.encode() if isinstance(given, str) else given)
    with rejected:
        ReadersFile(RELU, Path("relu.py"))


def test_a_file_that_is_called_otherwise(write: Write) -> None:
    """A file whose name does not end in .py is rejected, since Python loads no module from it."""
    with pytest.raises(ExerciseError, match=r"^relu\.txt: expected a Python module \(\.py\)$"):
        ReadersFile(RELU, write().rename("relu.txt"))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("forward(self, bottom: Blobs, top: Blobs)", "forward(self, bottom)",
         "ReLU.forward takes (self, bottom); expected (self, bottom, top)"),
        ("backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs)",
         "backward(self, bottom, top, propagate_down)",
         "ReLU.backward takes (self, bottom, top, propagate_down); expected (self, top, propagate_down, bottom)"),
        ("    def forward", "    @staticmethod\n    def forward",
         "ReLU.forward is a staticmethod; expected a plain method"),
        ("        top[0].data[...] =", "        yield\n        top[0].data[...] =",
         "ReLU.forward is a generator or coroutine"),
        ("class ReLU(Layer)", "class ReLU", "ReLU: expected class ReLU(Layer), as in the stub"),
    ],
)
def test_a_part_of_another_kind(old: str, new: str, said: str, write: Write) -> None:
    """A part of the wrong kind is reported, with the expected kind, before anything runs."""
    path = write()
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(ExerciseError) as error:
        ReadersFile(RELU, path)
    assert str(error.value).startswith("relu.py:") and said in str(error.value)


def test_other_names_and_more_arguments_will_do(write: Write) -> None:
    """Other parameter names and additional arguments are accepted if the part can be called in the same way."""
    path = write()
    text = path.read_text().replace("reshape(self, bottom: Blobs, top: Blobs)", "reshape(me, bottom, top, more=1)")
    path.write_text(text.replace("backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:",
                                 "backward(self, *all):\n        top, _, bottom = all"))
    reader = ReadersFile(RELU, path)
    assert all(step.passed for step in steps(RELU, LocalRunner(RELU, reader.part, reader)))


@pytest.mark.parametrize(
    ("raised", "said"),
    [
        ("type('Own', (BaseException,), {})('x')", "Own: x"),
        ("GeneratorExit", "GeneratorExit"),
        ("type('Own', (Exception,), {'__str__': lambda self: 1 / 0})()", "Own"),
    ],
)
def test_whatever_is_raised_is_told(raised: str, said: str, write: Write) -> None:
    """Any exception is reported, even a BaseException, or one that cannot be printed, with its line."""
    assert failed(write(forward=f"import os; os.chdir('/'); raise {raised}"))[0].endswith(f"): {said}")


def test_an_error_elsewhere_does_not_hide_a_difference(write: Write) -> None:
    """A known mistake is recognised even if the backward pass exits."""
    lines = failed(write(forward="top[0].data[...] = np.maximum(bottom[0].data, 0)", backward="raise SystemExit(3)"))
    assert lines[1].startswith("negative_slope is ignored")


def test_an_error_after_the_readers_code(write: Write) -> None:
    """An error raised after the reader's code has returned names the possible causes."""
    assert failed(write(forward="del top[0]"))[1].startswith("It was raised outside relu.py: check what your code")
