"""Layers of type Python: classes of the user, found as pycaffe finds them.

Only these layers execute code of a net.

Modules are searched for in the working directory and on PYTHONPATH. Many public nets name theirs
``layers`` or ``tools``, which are packages of this project too. For such names the user's own files
are searched first: a module is loaded under another name, and the folder of a package is added to
ours. In these modules ``import caffe`` returns netlib.caffe unless Caffe is installed.
"""

from __future__ import annotations

import contextlib
import importlib
import re
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import ModuleType

from netlib.errors import PrototxtError, did_you_mean
from netlib.files import own_modules
from netlib.files.paths import load_module, own
from netlib.layer import Layer
from netlib.proto import schema
from netlib.proto.messages import LayerParameter, PythonParameter

# Python 2 names in old layers
OLD_NAMES = {"xrange": range, "unicode": str, "basestring": str, "long": int}

PYTHON_2_MODULES = {
    "ConfigParser": "configparser",
    "Queue": "queue",
    "StringIO": "io",
    "cStringIO": "io",
    "cPickle": "pickle",
    "urllib2": "urllib.request",
    "urlparse": "urllib.parse",
    "__builtin__": "builtins",
    "commands": "subprocess",
    "Tkinter": "tkinter",
    "cv": "cv2",
}
# The messages of Python 3 about the syntax of Python 2: print and exec without parentheses, "except
# E, e", 0777, 10L, mixed tabs, <>, backquotes, and "raise E, text".
PYTHON_2_SYNTAX = re.compile(
    r"^(Missing parentheses in call to|multiple exception types must be|leading zeros in decimal"
    r"|inconsistent use of tabs|invalid decimal literal: .*\d+L"
    r"|invalid syntax.*: (.*<>|.*`|raise \w+, |except \w+, \w+:|print |exec ))"
)
CONVERT = "docs/caffe.md, Scripts for Python 2"

# A value of the process: a command that forbids layers of type Python forbids them in all nets that
# are built while it runs, also where a library or a solver file builds them and passes no argument.
_are_allowed = True


@contextlib.contextmanager
def allowed(are: bool) -> Iterator[None]:
    """Context manager: unless ``are`` is true, nets of this process may not have layers
    of type Python.
    """
    global _are_allowed
    before, _are_allowed = _are_allowed, _are_allowed and are
    try:
        yield
    finally:
        _are_allowed = before


def check_allowed(specs: Iterable[LayerParameter], are: bool) -> None:
    """Raise PrototxtError if a layer is of type Python and ``are`` or the process
    does not allow it.
    """
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
        raise PrototxtError(
            schema.position_of(spec), f"layer {spec.name!r} of type 'Python' needs a python_param"
        )
    param = schema.read(block, PythonParameter, "python_param")
    if "" not in sys.path:
        sys.path.append("")  # the working directory, as in pycaffe
    try:
        module, where = _import(param.module, param.layer)
    except (Exception, SystemExit) as error:
        raise PrototxtError(
            schema.position_of(param, "module"),
            f"layer {spec.name!r}: cannot import {param.module!r} ({type(error).__name__}: {error})"
            f"{_advice(error, param.module)}",
        ) from error
    for name, value in OLD_NAMES.items():
        vars(module).setdefault(name, value)
    cls = getattr(module, param.layer, None)
    if not (isinstance(cls, type) and issubclass(cls, Layer)):
        found = (
            f"{param.module}.{param.layer} is not a subclass of netlib.Layer, which is caffe.Layer"
        )
        if cls is None and own_modules.is_ours(module):
            found = (
                f"{param.module}.{param.layer} was looked for in this project's own package ({where}); expected a "
                f"module {param.module!r} with it in the working directory or on PYTHONPATH"
            )
        elif cls is None:
            classes = [name for name, value in vars(module).items() if isinstance(value, type)]
            found = f"{where} has no class {param.layer!r}{did_you_mean(param.layer, classes)}"
        raise PrototxtError(schema.position_of(param, "layer"), f"layer {spec.name!r}: {found}")
    return cls


def _advice(error: BaseException, module: str) -> str:
    """What to do about an error of an import."""
    if isinstance(error, ModuleNotFoundError) and f"{module}.".startswith(f"{error.name}."):
        return "; it must lie in the working directory or on PYTHONPATH"
    if isinstance(error, ModuleNotFoundError) and error.name and error.name not in PYTHON_2_MODULES:
        return f"; install the package that has {error.name.partition('.')[0]!r}, or put it on PYTHONPATH"
    return python_2_advice(error)


def python_2_advice(error: BaseException) -> str:
    """What to do about an error of a file for Python 2; empty for others."""
    if isinstance(error, ModuleNotFoundError) and error.name in PYTHON_2_MODULES:
        return f"; it was written for Python 2: {error.name} is now {PYTHON_2_MODULES[error.name]} ({CONVERT})"
    if isinstance(error, SyntaxError) and PYTHON_2_SYNTAX.search(
        f"{error.msg}: {(error.text or '').strip()}"
    ):
        return f"; it was written for Python 2: convert it to Python 3 ({CONVERT})"
    return ""


def _import(name: str, wanted: str) -> tuple[ModuleType, str]:
    """Import the module ``name`` and return it with its file.

    If a package here has the same name, the user's own module is preferred if it
    defines ``wanted``.
    """
    if not own_modules.has_caffe():
        own_modules.take_caffe()
        own_modules.yield_names()
    top, _, inner = name.partition(".")
    is_shared = top in own_modules.NAMES
    if (
        is_shared
        and hasattr(sys.modules.get(name), wanted)
        and not own_modules.is_ours(sys.modules[top])
    ):
        return sys.modules[name], name  # imported by the user's script
    with own_modules.in_place() if is_shared else contextlib.nullcontext():
        if (own(top) / "__init__.py").is_file():
            if inner:
                _add_folders(importlib.import_module(top))
            theirs = _own_file(name)
            if theirs is not None:
                module = load_module(f"{name} of {theirs}", theirs)
                if hasattr(module, wanted):
                    return module, str(theirs)
        module = importlib.import_module(name)
    return module, getattr(module, "__file__", None) or name


def _add_folders(package: ModuleType) -> None:
    """Let a package of this project also find the modules of the user's package of
    the same name.
    """
    for folder in map(Path, own_modules.folders()):
        inner = str((folder / package.__name__).resolve())
        if Path(inner).is_dir() and inner not in package.__path__:
            package.__path__.append(inner)


def _own_file(name: str) -> Path | None:
    """The user's own ``name.py`` or ``name/__init__.py``, if it exists besides this project's
    package of that name.
    """
    inner = Path(*name.split("."))
    for folder in map(Path, own_modules.folders()):
        for path in (folder / f"{inner}.py", folder / inner / "__init__.py"):
            if path.is_file():
                return path.resolve()
    return None
