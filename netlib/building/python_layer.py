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

from netlib.errors import LayerError, PrototxtError, did_you_mean
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

# Of the process, because a net may also be built by a library or a solver file, which pass no
# argument.
_process_allows = True


@contextlib.contextmanager
def allowed(by_caller: bool) -> Iterator[None]:
    """Context manager: unless ``by_caller`` is true, nets of this process may not have layers
    of type Python.
    """
    global _process_allows
    before = _process_allows
    _process_allows = before and by_caller
    try:
        yield
    finally:
        _process_allows = before


def check_allowed(specs: Iterable[LayerParameter], by_caller: bool) -> None:
    """Raise PrototxtError if a layer is of type Python, unless both the caller and the process
    allow it.
    """
    if by_caller and _process_allows:
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
        module = _import(param.module, param.layer)
    except (Exception, SystemExit) as error:
        raise PrototxtError(
            schema.position_of(param, "module"),
            f"layer {spec.name!r}: cannot import {param.module!r} ({type(error).__name__}: {error})"
            f"{_import_advice(error, param.module)}",
        ) from error
    for name, value in OLD_NAMES.items():
        vars(module).setdefault(name, value)
    cls = getattr(module, param.layer, None)
    if not (isinstance(cls, type) and issubclass(cls, Layer)):
        found = (
            f"{param.module}.{param.layer} is not a subclass of netlib.Layer, which is caffe.Layer"
        )
        if cls is None:
            found = _found_instead(module, param)
        raise PrototxtError(schema.position_of(param, "layer"), f"layer {spec.name!r}: {found}")
    return cls


def check_attributes(layer: Layer, spec: LayerParameter, name: str) -> None:
    """Raise LayerError if the layer's own code set an attribute by which its net knows it."""
    for attribute, value in (("name", name), ("spec", spec)):
        if getattr(layer, attribute) is not value:
            raise LayerError(
                f"{schema.position_of(spec)}: error: layer {name!r}: its class sets the attribute "
                f"{attribute!r}, which is the net's; give it another name"
            )


def _found_instead(module: ModuleType, param: PythonParameter) -> str:
    """What a module has that lacks the class that ``param`` names."""
    path = getattr(module, "__file__", None) or param.module
    if own_modules.is_ours(module):
        return (
            f"{param.module}.{param.layer} was looked for in this project's own package ({path}); expected a "
            f"module {param.module!r} with it in the working directory or on PYTHONPATH"
        )
    classes = [name for name, value in vars(module).items() if isinstance(value, type)]
    return f"{path} has no class {param.layer!r}{did_you_mean(param.layer, classes)}"


def _import_advice(error: BaseException, module: str) -> str:
    """Advice on an error of the import of ``module``; empty if there is none."""
    missing = error.name if isinstance(error, ModuleNotFoundError) else None
    if missing and f"{module}.".startswith(f"{missing}."):
        return "; it must lie in the working directory or on PYTHONPATH"
    if missing and missing not in PYTHON_2_MODULES:
        return (
            f"; install the package that has {missing.partition('.')[0]!r}, or put it on PYTHONPATH"
        )
    return python_2_advice(error)


def python_2_advice(error: BaseException) -> str:
    """Advice on an error of a file that was written for Python 2; empty for other errors."""
    if isinstance(error, ModuleNotFoundError) and error.name in PYTHON_2_MODULES:
        return f"; it was written for Python 2: {error.name} is now {PYTHON_2_MODULES[error.name]} ({CONVERT})"
    if isinstance(error, SyntaxError):
        line = (error.text or "").strip()
        if PYTHON_2_SYNTAX.search(f"{error.msg}: {line}"):
            return f"; it was written for Python 2: convert it to Python 3 ({CONVERT})"
    return ""


def _import(name: str, wanted: str) -> ModuleType:
    """Import the module ``name``.

    If a package here has the same name, the user's own module is preferred if it
    defines ``wanted``.
    """
    if not own_modules.has_caffe():
        own_modules.take_caffe()
        own_modules.yield_names()
    top = name.partition(".")[0]
    is_shared = top in own_modules.NAMES
    is_imported = hasattr(sys.modules.get(name), wanted)
    if is_shared and is_imported and not own_modules.is_ours(sys.modules[top]):
        return sys.modules[name]  # imported by the user's script
    with own_modules.in_place() if is_shared else contextlib.nullcontext():
        return _users_module(name, wanted) or importlib.import_module(name)


def _users_module(name: str, wanted: str) -> ModuleType | None:
    """The user's own module of a name that a package of this project has, too; None if it does
    not define ``wanted``, or if no package has its name.
    """
    top, _, inner = name.partition(".")
    if not (own(top) / "__init__.py").is_file():
        return None
    if inner:
        _add_folders(importlib.import_module(top))
    path = _users_file(name)
    if path is None:
        return None
    module = load_module(f"{name} of {path}", path)
    return module if hasattr(module, wanted) else None


def _add_folders(package: ModuleType) -> None:
    """Let a package of this project also find the modules of the user's package of
    the same name.
    """
    for folder in own_modules.folders():
        users = Path(folder, package.__name__).resolve()
        if users.is_dir() and str(users) not in package.__path__:
            package.__path__.append(str(users))


def _users_file(name: str) -> Path | None:
    """The user's file of the module ``name``: ``name.py`` or ``name/__init__.py``."""
    inner = Path(*name.split("."))
    for folder in own_modules.folders():
        for file in (f"{inner}.py", inner / "__init__.py"):
            path = Path(folder, file)
            if path.is_file():
                return path.resolve()
    return None
