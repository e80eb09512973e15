"""The reader's file: loaded as a module, and where in it something stands or went wrong."""

from __future__ import annotations

import ast
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from netlib import files
from netlib.errors import NetlibError, reason_of
from netlib.paths import load_module
from tools.exercises.exercise import Exercise, Part


class ExerciseError(NetlibError):
    """A reader's file that cannot be checked."""


class ReadersFile:
    """A file with the reader's solution of an exercise. Raises ExerciseError if it cannot be loaded.

    path    as the user named it
    lines   function or ``Class.method`` -> its line
    to_do   those that are still to be written -> the line that says so
    needed  those of them that something asks for
    part    what was written
    """

    def __init__(self, exercise: Exercise, path: Path) -> None:
        self.path = path
        text = files.read_text(path, f"the exercise {exercise.name}", ExerciseError)
        try:
            tree = ast.parse(text, str(path))
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:  # ValueError: a NUL in it
            raise ExerciseError(f"{path}{self._line_of(error)}: {reason_of(error)}") from error
        self.lines = {name: node.lineno for name, node in functions(tree)}
        self.to_do = {name: line for name, node in functions(tree) if (line := _raises_not_implemented(node))}
        self.needed = {name for name in self.to_do if name in exercise.names or _is_used(name, tree)}
        module = self._load(exercise)
        missing = [name for name in exercise.names if not _has(module, name)]
        if missing:
            raise ExerciseError(f"{path}: has no {' and no '.join(missing)}; keep the names of the stub, which "
                                f"--start writes")  # fmt: skip
        self.part: Part = exercise.part_of(module)

    def _load(self, exercise: Exercise) -> ModuleType:
        name = f"{exercise.name} of {self.path.resolve()}"
        sys.modules.pop(name, None)
        kept, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # an old .pyc might be taken for the new file
        try:
            return load_module(name, self.path.resolve())
        except (Exception, SystemExit) as error:
            raise ExerciseError(f"{self.where(error) or self.path}: {told(error)}") from error
        finally:
            sys.dont_write_bytecode = kept

    def _line_of(self, error: BaseException) -> str:
        return f":{error.lineno}" if isinstance(error, SyntaxError) and error.lineno else ""

    def where(self, error: BaseException) -> str | None:
        """``file:line`` of the reader's own code that an error came from, with the line itself; None if not from it."""
        mine = str(self.path.resolve())
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == mine]
        if not frames:
            return None
        return f"{self.path}:{frames[-1].lineno}" + (f" ({frames[-1].line})" if frames[-1].line else "")

    def function_at(self, error: BaseException) -> str | None:
        """The function of the reader's own in which an error was raised, as the message calls it."""
        mine = str(self.path.resolve())
        names = [frame.name for frame in traceback.extract_tb(error.__traceback__) if frame.filename == mine]
        return next((full for full in self.to_do if names and full.split(".")[-1] == names[-1]), None)


def told(error: BaseException) -> str:
    """An error in one line."""
    text = str(error).strip().split("\n")[0]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def functions(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef]]:
    """The functions of a file by name, its methods as ``Class.method``."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from ((f"{node.name}.{inner.name}", inner) for inner in node.body
                        if isinstance(inner, ast.FunctionDef))  # fmt: skip


def _is_used(name: str, tree: ast.Module) -> bool:
    """Does the file ask for a function or method somewhere?"""
    last = name.split(".")[-1]
    return any(last in (getattr(node, "attr", None), getattr(node, "id", None)) for node in ast.walk(tree))


def _raises_not_implemented(function: ast.FunctionDef) -> int | None:
    """The line of a ``raise NotImplementedError`` in a function, None without one."""
    for node in ast.walk(function):
        if isinstance(node, ast.Raise) and node.exc is not None:
            raised = node.exc.func if isinstance(node.exc, ast.Call) else node.exc
            if isinstance(raised, ast.Name) and raised.id == "NotImplementedError":
                return node.lineno
    return None


def _has(module: ModuleType, name: str) -> bool:
    thing: object = module
    for part in name.split("."):
        thing = getattr(thing, part, None)
    return callable(thing)
