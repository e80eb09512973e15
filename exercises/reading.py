"""The reader's file: loaded as a module, and where in it something stands or went wrong."""

from __future__ import annotations

import ast
import importlib
import inspect
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from exercises.exercise import Exercise, Part
from netlib import files
from netlib.errors import NetlibError, reason_of
from netlib.files.paths import load_module


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
        self._whole = path.resolve()  # now: the reader's code may go to another folder
        text = files.read_text(path, f"the exercise {exercise.name}", ExerciseError)
        if path.suffix != ".py":
            raise ExerciseError(f"{path}: is no module; expected a file whose name ends in .py")
        try:
            tree = ast.parse(text, str(path))
            compile(text, str(path), "exec", dont_inherit=True)  # finds what a tree may have, and a program not
        except SyntaxError as error:
            raise ExerciseError(f"{path}:{error.lineno or 1}: {error.msg}") from error
        except (ValueError, RecursionError, MemoryError) as error:  # ValueError: a NUL in it
            raise ExerciseError(f"{path}: {reason_of(error)}") from error
        self.lines = {name: node.lineno for name, node in functions(tree)}
        self.to_do = {name: line for name, node in functions(tree) if (line := _raises_not_implemented(node))}
        self.needed = {name for name in self.to_do if name in exercise.names or _is_used(name, tree)}
        module = self._load(exercise)
        missing = [name for name in exercise.names if not _has(module, name)]
        if missing:
            raise ExerciseError(f"{path}: has no {' and no '.join(missing)}; keep the names of the stub, which "
                                f"--start writes")  # fmt: skip
        self._check_kinds(exercise, module)
        self.part: Part = exercise.part_of(module)

    def _load(self, exercise: Exercise) -> ModuleType:
        name = f"{exercise.name} of {self._whole}"
        sys.modules.pop(name, None)
        kept, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # an old .pyc might be taken for the new file
        try:
            return load_module(name, self._whole)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # SystemExit, or one of the reader's own
            raise ExerciseError(f"{self.where(error) or self.path}: {told(error)}") from error
        finally:
            sys.dont_write_bytecode = kept

    def _check_kinds(self, exercise: Exercise, module: ModuleType) -> None:
        """Raise ExerciseError if a class is of another kind than ours, or a function takes other arguments."""
        source = importlib.import_module(exercise.file.removesuffix(".py").replace("/", "."))
        for whole in exercise.names:
            place = f"{self.path}:{self.lines[whole]}" if whole in self.lines else str(self.path)
            name = whole.split(".")[0]
            ours, mine = getattr(source, name), getattr(module, name)
            if isinstance(ours, type) and not (isinstance(mine, type) and issubclass(mine, ours.__bases__)):
                bases = ", ".join(base.__name__ for base in ours.__bases__)
                raise ExerciseError(f"{place}: {name} is no such class; expected class {name}({bases}), as in the stub")
            if fault := _fault_of(_named(module, whole), _named(source, whole)):
                raise ExerciseError(f"{place}: {whole} {fault}")

    def where(self, error: BaseException) -> str | None:
        """``file:line`` of the reader's own code that an error came from, with the line itself; None if not from it."""
        mine = str(self._whole)
        frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename == mine]
        if not frames:
            return None
        return f"{self.path}:{frames[-1].lineno}" + (f" ({frames[-1].line})" if frames[-1].line else "")

    def function_at(self, error: BaseException) -> str | None:
        """The function of the reader's own in which an error was raised, as the message calls it."""
        mine = str(self._whole)
        names = [frame.name for frame in traceback.extract_tb(error.__traceback__) if frame.filename == mine]
        return next((full for full in self.to_do if names and full.split(".")[-1] == names[-1]), None)


def told(error: BaseException) -> str:
    """An error in one line."""
    try:
        text = str(error).strip().split("\n")[0]
    except Exception:  # it is the reader's, too
        text = ""
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def functions(tree: ast.Module) -> Iterator[tuple[str, ast.FunctionDef]]:
    """The functions of a file by name, its methods as ``Class.method``."""
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            yield node.name, node
        elif isinstance(node, ast.ClassDef):
            yield from ((f"{node.name}.{inner.name}", inner) for inner in node.body
                        if isinstance(inner, ast.FunctionDef))  # fmt: skip


def body_lines(function: ast.FunctionDef) -> tuple[int, int]:
    """The first and the last line of a function's body after its docstring."""
    body = function.body
    has_docstring = ast.get_docstring(function) is not None
    first = (body[0].end_lineno or 0) + 1 if has_docstring else body[0].lineno
    return first, function.end_lineno or first


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
    return callable(_named(module, name))


def _named(module: ModuleType, name: str) -> Any:
    """A function, or a method as its class has it; None without."""
    thing: object = module
    for part in name.split("."):
        thing = inspect.getattr_static(thing, part, None)
    return thing


def _fault_of(mine: Callable[..., object], ours: Callable[..., object]) -> str | None:
    """What is wrong with how a function is called; None if it can be called as ours."""
    if inspect.isgeneratorfunction(mine) or inspect.iscoroutinefunction(mine):
        return "has a yield or an async: nothing of it runs when it is called"
    if isinstance(mine, (staticmethod, classmethod)) and not isinstance(ours, type(mine)):
        return f"is a {type(mine).__name__}; expected none, as in the stub"
    try:
        taken, wanted = inspect.signature(mine), inspect.signature(ours)
    except (TypeError, ValueError):  # of what is written in C
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
