"""Layers of type Python: classes of the user, found as pycaffe finds them. Only these layers execute code of a net.

Modules are searched for in the working directory and on PYTHONPATH. Many public nets name theirs ``layers`` or
``tools``, which are packages of this project too. For such names the user's own files are searched first: a module is
loaded under another name, and the folder of a package is added to ours. In these modules ``import caffe`` returns
netlib.caffe unless Caffe is installed.

A module is executed only if its source may define the class.
"""

from __future__ import annotations

import ast
import contextlib
import importlib
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from importlib.machinery import ModuleSpec
from importlib.util import decode_source
from pathlib import Path
from types import ModuleType

from netlib.errors import PrototxtError
from netlib.files import own_modules
from netlib.files.paths import load_module, own
from netlib.layer import Layer
from netlib.proto import schema
from netlib.proto.messages import LayerParameter, PythonParameter

OLD_NAMES = {"xrange": range, "unicode": str, "basestring": str, "long": int}  # Python 2 names in old layers
# A module that uses one of these may define names that do not appear in its source.
DYNAMIC = {"__dict__", "__getattr__", "__import__", "eval", "exec", "globals", "locals", "modules", "setattr", "vars"}

_are_allowed = True


def _nothing() -> None:
    """Default of ``before_import``."""


before_import: Callable[[], None] = _nothing  # called before a user's module is imported; netlib sets it


@contextlib.contextmanager
def allowed(are: bool) -> Iterator[None]:
    """Context manager: unless ``are`` is true, nets of this process may not have layers of type Python."""
    global _are_allowed
    before, _are_allowed = _are_allowed, _are_allowed and are
    try:
        yield
    finally:
        _are_allowed = before


def check_allowed(specs: Iterable[LayerParameter], are: bool) -> None:
    """Raise PrototxtError if a layer is of type Python and ``are`` or the process does not allow it."""
    if are and _are_allowed:
        return
    for spec in specs:
        if spec.type == "Python":
            raise PrototxtError(
                schema.position_of(spec, "type"),
                f"layer {spec.name!r} is of type 'Python', which executes code of the net's author; this is not "
                "allowed here. If you trust the author, omit --no-python-layers or python_layers=False",
            )


def find_class(spec: LayerParameter) -> type[Layer]:
    """Return the class that a layer of type Python names. Raises PrototxtError."""
    block = spec.blocks.get("python_param")
    if block is None:
        raise PrototxtError(schema.position_of(spec), f"layer {spec.name!r} of type 'Python' needs a python_param")
    param = schema.read(block, PythonParameter, "python_param")
    if "" not in sys.path:
        sys.path.append("")  # the working directory, as in pycaffe
    try:
        module, where = _import(param.module, param.layer)
    except (Exception, SystemExit) as error:
        raise PrototxtError(
            schema.position_of(param, "module"),
            f"layer {spec.name!r}: cannot import {param.module!r} ({type(error).__name__}: {error}); "
            "it must lie in the working directory or on PYTHONPATH",
        ) from error
    cls = None
    if module is not None:
        for name, value in OLD_NAMES.items():
            vars(module).setdefault(name, value)
        cls = getattr(module, param.layer, None)
    if not (isinstance(cls, type) and issubclass(cls, Layer)):
        found = "is not a subclass of netlib.Layer"
        if cls is None and module is not None and own_modules.is_ours(module):
            found = (f"was looked for in this project's own package ({where}); expected a module {param.module!r} with "
                     "it in the working directory or on PYTHONPATH")
        elif cls is None:
            found = f"has no such class ({where})"
        raise PrototxtError(
            schema.position_of(param, "layer"), f"layer {spec.name!r}: {param.module}.{param.layer} {found}"
        )
    return cls


def _import(name: str, wanted: str) -> tuple[ModuleType | None, str]:
    """Import the module ``name`` and return it with its file. If a package here has the same name, the user's own
    module is preferred if it defines ``wanted``.

    Returns None instead of a module, without executing it, if the file cannot define ``wanted``.
    """
    before_import()
    top = name.partition(".")[0]
    if top not in own_modules.NAMES:
        return _import_any(name, wanted)
    if hasattr(sys.modules.get(name), wanted) and not own_modules.is_ours(sys.modules[top]):
        return sys.modules[name], name  # imported by the user's script
    with own_modules.in_place():
        return _import_any(name, wanted)


def _import_any(name: str, wanted: str) -> tuple[ModuleType | None, str]:
    """Like ``_import``, with this project's packages in sys.modules."""
    top, _, inner = name.partition(".")
    if _is_ours(top):
        if inner:
            _add_folders(importlib.import_module(top))
        theirs = _own_file(name)
        if theirs is not None and _may_have(theirs, wanted):
            module = load_module(f"{name} of {theirs}", theirs)
            if hasattr(module, wanted):
                return module, str(theirs)
    file = _file_of(name)
    if file is not None and not _may_have(file, wanted):
        return None, str(file)
    module = importlib.import_module(name)
    return module, getattr(module, "__file__", None) or name


def _is_ours(top: str) -> bool:
    return (own(top) / "__init__.py").is_file()


def _folders() -> list[Path]:
    """Folders to search for the user's modules: sys.path without the project's root."""
    return [Path(folder) for folder in own_modules.folders()]


def _add_folders(package: ModuleType) -> None:
    """Let a package of this project also find the modules of the user's package of the same name."""
    for folder in _folders():
        inner = str((folder / package.__name__).resolve())
        if Path(inner).is_dir() and inner not in package.__path__:
            package.__path__.append(inner)


def _own_file(name: str) -> Path | None:
    """The user's own ``name.py`` or ``name/__init__.py``, if it exists besides this project's package of that name."""
    inner = Path(*name.split("."))
    for folder in _folders():
        for path in (folder / f"{inner}.py", folder / inner / "__init__.py"):
            if path.is_file():
                return path.resolve()
    return None


# ---------------------------------------------------------------------------------------------- before execution


def _file_of(name: str) -> Path | None:
    """Source file that an import would execute; None if unknown. Raises ModuleNotFoundError."""
    file: Path | None = None
    places: list[str] | None = None  # search path: the package's folders, at first sys.path
    parts = name.split(".")
    for known in (".".join(parts[: i + 1]) for i in range(len(parts) if all(parts) else 0)):
        if known in sys.modules:
            file, places = None, list(getattr(sys.modules[known], "__path__", []))
            continue
        try:
            spec = _spec_of(known, places)
        except KeyError:  # raised by importlib for a namespace package whose parent is not imported
            return None
        if spec is None:
            if file is not None and {"path", "__path__", *DYNAMIC} & _names(file)[1]:
                return None  # the package may set its search path when it runs
            raise ModuleNotFoundError(f"No module named {known!r}", name=known)
        file = Path(spec.origin) if spec.origin is not None and spec.origin.endswith(".py") else None
        places = list(spec.submodule_search_locations or [])
    return file


def _spec_of(name: str, places: list[str] | None) -> ModuleSpec | None:
    """Find the spec of a module without importing it."""
    for finder in sys.meta_path:
        spec: ModuleSpec | None = finder.find_spec(name, places) if hasattr(finder, "find_spec") else None
        if spec is not None:
            return spec
    return None


def _may_have(file: Path, name: str) -> bool:
    """Whether the module may define the name: a statement binds it, or the module defines names dynamically."""
    bound, used = _names(file)
    return bool({name, "*"} & bound or DYNAMIC & used)


def _names(file: Path) -> tuple[set[str], set[str]]:
    """Names that the statements of a module bind, and all names that it uses. ``import *`` binds "*"."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # they are shown when the module runs
        tree = ast.parse(decode_source(file.read_bytes()), str(file))
    bound, used = set(), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.alias):
            bound.add(node.asname or node.name.partition(".")[0])
            used.add(node.name)
        elif isinstance(node, (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            bound.add(node.name)
        elif isinstance(node, ast.Name):
            (bound if isinstance(node.ctx, ast.Store) else used).add(node.id)
        elif isinstance(node, ast.Attribute):
            used.add(node.attr)
    return bound, used | bound
