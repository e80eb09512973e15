"""Load the reader's file as a module, and find the lines of its functions and errors."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from exercises.exercise import Exercise, Part
from netlib import files
from netlib.errors import NetlibError, reason_of
from netlib.files.paths import load_module

MAX_BYTES = 1 << 20  # of a reader's file
MAX_TEXT = 500  # characters of an exception's text


class ExerciseError(NetlibError):
    """Raised if a reader's file cannot be checked."""


@dataclass(frozen=True)
class Outline:
    """What a reader's file defines.

    path    as given by the user
    lines   maps a function or ``Class.method`` to its line
    to_do   maps those not yet written to the line that raises NotImplementedError
    needed  the names in to_do that are required or used
    """

    path: Path
    lines: Mapping[str, int]
    to_do: Mapping[str, int]
    needed: frozenset[str]


@dataclass(frozen=True)
class Failure:
    """An exception in a part.

    text          the exception on one line
    where         ``file:line`` and the source line of the reader's code that raised it, if any did
    function      the qualified name of the reader's function that is not yet written and raised it, if any did
    is_unwritten  whether it says that a function is not yet written
    assigns       whether it was raised by an assignment to an attribute that can only be written into
    """

    text: str
    where: str | None = None
    function: str | None = None
    is_unwritten: bool = False
    assigns: bool = False


class ReadersFile:
    """The file with the reader's solution of an exercise. Raises ExerciseError if it cannot be loaded.

    outline  what it defines
    part     the solution
    """

    def __init__(self, exercise: Exercise, path: Path) -> None:
        self.path = path
        self._whole = path.resolve()  # resolved now: the reader's code may change the working directory
        text = files.read_text(path, f"the exercise {exercise.name}", ExerciseError, limit=MAX_BYTES)
        if path.suffix != ".py":
            raise ExerciseError(f"{path}: expected a Python module (.py)")
        try:
            tree = ast.parse(text, str(path))
            compile(text, str(path), "exec", dont_inherit=True)  # finds errors that ast.parse does not
        except SyntaxError as error:
            raise ExerciseError(f"{path}:{error.lineno or 1}: {error.msg}") from error
        except (ValueError, RecursionError, MemoryError) as error:  # ValueError: a NUL character
            raise ExerciseError(f"{path}: {reason_of(error)}") from error
        to_do = {name: line for name, node in functions(tree) if (line := _raises_not_implemented(node))}
        needed = frozenset(name for name in to_do if name in exercise.names or _is_used(name, tree))
        self.outline = Outline(path, {name: node.lineno for name, node in functions(tree)}, to_do, needed)
        module = self._load(exercise)
        missing = [name for name in exercise.names if not _has(module, name)]
        if missing:
            raise ExerciseError(f"{path}: {', '.join(missing)} missing; keep the names of the stub that --start "
                                "writes")
        self._check_kinds(exercise, module)
        self.part: Part = exercise.part_of(module)

    def _load(self, exercise: Exercise) -> ModuleType:
        name = f"{exercise.name} of {self._whole}"
        sys.modules.pop(name, None)
        kept, sys.dont_write_bytecode = (
            sys.dont_write_bytecode,
            True,
        )  # a stale .pyc might be used instead of the new file
        try:
            return load_module(name, self._whole)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # including SystemExit and the reader's own exceptions
            raise ExerciseError(f"{self.where(error) or self.path}: {describe(error)}") from error
        finally:
            sys.dont_write_bytecode = kept

    def _check_kinds(self, exercise: Exercise, module: ModuleType) -> None:
        """Raise ExerciseError if the base classes or the parameters differ from the reference."""
        source = importlib.import_module(exercise.file.removesuffix(".py").replace("/", "."))
        for whole in exercise.names:
            lines = self.outline.lines
            place = f"{self.path}:{lines[whole]}" if whole in lines else str(self.path)
            name = whole.split(".")[0]
            reference, mine = getattr(source, name), getattr(module, name)
            if isinstance(reference, type) and not (isinstance(mine, type) and issubclass(mine, reference.__bases__)):
                bases = ", ".join(base.__name__ for base in reference.__bases__)
                raise ExerciseError(f"{place}: {name}: expected class {name}({bases}), as in the stub")
            if fault := _fault_of(_named(module, whole), _named(source, whole)):
                raise ExerciseError(f"{place}: {whole} {fault}")

    def where(self, error: BaseException) -> str | None:
        """Return ``file:line`` and the source line of the reader's code that raised an error; None if none did."""
        mine = str(self._whole)
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == mine]
        if not frames:
            return None
        return f"{self.path}:{frames[-1].lineno}" + (f" ({frames[-1].line})" if frames[-1].line else "")

    def function_at(self, error: BaseException) -> str | None:
        """Return the qualified name of the reader's unwritten function that raised an error; None if none did."""
        mine = str(self._whole)
        names = [frame.name for frame in traceback.extract_tb(error.__traceback__) if frame.filename == mine]
        return next((full for full in self.outline.to_do if names and full.split(".")[-1] == names[-1]), None)


def failure_of(error: BaseException, reader: ReadersFile | None) -> Failure:
    """Describe an exception that a part raised."""
    causes = [error] if error.__cause__ is None else [error, error.__cause__]
    where = next((where for cause in causes if (where := reader.where(cause))), None) if reader else None
    text = _text(error)
    return Failure(
        text=text if text and isinstance(error, NetlibError) else describe(error),
        where=where,
        function=reader.function_at(error) if reader else None,
        is_unwritten=isinstance(error, NotImplementedError),
        assigns=isinstance(error, AttributeError) and bool(re.search("no setter|can't set", text)),
    )


def _text(error: BaseException) -> str:
    """Return the first line of an exception's text."""
    try:
        return str(error).strip().split("\n")[0][:MAX_TEXT]
    except Exception:  # the reader's exception may fail in __str__
        return ""


def describe(error: BaseException) -> str:
    """Format an exception on one line."""
    text = _text(error)
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def functions(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef]]:
    """Yield the functions of a file by name, methods as ``Class.method``."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from ((f"{node.name}.{inner.name}", inner) for inner in node.body
                        if isinstance(inner, ast.FunctionDef))


def body_lines(function: ast.FunctionDef) -> tuple[int, int]:
    """Return the first and last line of a function's body, without its docstring."""
    body = function.body
    has_docstring = ast.get_docstring(function) is not None
    first = (body[0].end_lineno or 0) + 1 if has_docstring else body[0].lineno
    return first, function.end_lineno or first


def _is_used(name: str, tree: ast.Module) -> bool:
    """Return whether the file uses a function or method."""
    last = name.split(".")[-1]
    return any(last in (getattr(node, "attr", None), getattr(node, "id", None)) for node in ast.walk(tree))


def _raises_not_implemented(function: ast.FunctionDef) -> int | None:
    """Return the line of a ``raise NotImplementedError`` in a function; None if there is none."""
    for node in ast.walk(function):
        if isinstance(node, ast.Raise) and node.exc is not None:
            raised = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
            if isinstance(raised, ast.Name) and raised.id == "NotImplementedError":
                return node.lineno
    return None


def _has(module: ModuleType, name: str) -> bool:
    return callable(_named(module, name))


def _named(module: ModuleType, name: str) -> Any:
    """Return a function, or a method as stored in its class; None if it does not exist."""
    thing: object = module
    for part in name.split("."):
        thing = inspect.getattr_static(thing, part, None)
    return thing


def _fault_of(mine: Callable[..., object], reference: Callable[..., object]) -> str | None:
    """Describe why a function cannot be called like the reference; None if it can."""
    if inspect.isgeneratorfunction(mine) or inspect.iscoroutinefunction(mine):
        return "is a generator or coroutine: calling it does not run its body"
    if isinstance(mine, (staticmethod, classmethod)) and not isinstance(reference, type(mine)):
        return f"is a {type(mine).__name__}; expected a plain method, as in the stub"
    try:
        taken, wanted = inspect.signature(mine), inspect.signature(reference)
    except (TypeError, ValueError):  # functions written in C
        return None
    names = [p.name for p in wanted.parameters.values() if p.default is p.empty]
    own = [p for p in taken.parameters if p in wanted.parameters]
    try:
        taken.bind(*names)
        if own == [p for p in wanted.parameters if p in own]:
            return None
    except TypeError:
        pass
    return f"takes ({', '.join(taken.parameters)}); expected ({', '.join(wanted.parameters)})"
