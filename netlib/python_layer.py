"""Layers of type Python: the user's own classes, found as pycaffe finds them.

A module is looked for in the working directory and on PYTHONPATH. Public nets like to call theirs ``layers`` or
``tools``, which are packages here as well. Such a module is looked for among the user's own files first: it is loaded
under another name, and a package of that name adds its folder to ours. What the module imports as ``caffe`` is
netlib.caffe, unless a Caffe is installed.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from netlib import schema
from netlib.errors import PrototxtError
from netlib.install import install_if_missing
from netlib.layer import Layer, PythonParameter
from netlib.messages import LayerParameter
from netlib.paths import ROOT

OLD_NAMES = {"xrange": range, "unicode": str, "basestring": str, "long": int}  # Python 2's, which old layers use


def find_class(spec: LayerParameter) -> type[Layer]:
    """The class that a layer of type Python names. Raises PrototxtError."""
    block = spec.blocks.get("python_param")
    if block is None:
        raise PrototxtError(schema.position_of(spec), f"layer {spec.name!r} of type 'Python' needs a python_param")
    param = schema.read(block, PythonParameter, "python_param")
    if "" not in sys.path:
        sys.path.append("")  # the working directory, as in pycaffe
    try:
        module = _import(param.module, param.layer)
    except (Exception, SystemExit) as error:
        raise PrototxtError(
            schema.position_of(param, "module"),
            f"layer {spec.name!r}: cannot import {param.module!r} ({type(error).__name__}: {error}); "
            "it must lie in the working directory or on PYTHONPATH",
        ) from error
    for name, value in OLD_NAMES.items():
        vars(module).setdefault(name, value)
    cls = getattr(module, param.layer, None)
    if not (isinstance(cls, type) and issubclass(cls, Layer)):
        where = getattr(module, "__file__", param.module)
        found = f"has no such class ({where})" if cls is None else "is not a subclass of netlib.Layer"
        raise PrototxtError(
            schema.position_of(param, "layer"), f"layer {spec.name!r}: {param.module}.{param.layer} {found}"
        )
    return cls


def _import(name: str, wanted: str) -> ModuleType:
    """The module ``name``; where a package here has this name, too, the user's own if it has the class ``wanted``."""
    install_if_missing()
    top, _, inner = name.partition(".")
    if _is_ours(top):
        if inner:
            _add_folders(importlib.import_module(top))
        own = _own_file(name)
        if own is not None and hasattr(own, wanted):
            return own
    return importlib.import_module(name)


def _is_ours(top: str) -> bool:
    return (ROOT / top / "__init__.py").is_file()


def _folders() -> list[Path]:
    """Where the user's modules may lie: sys.path without our own root."""
    return [folder for folder in map(Path, dict.fromkeys(sys.path)) if folder.resolve() != ROOT]


def _add_folders(package: ModuleType) -> None:
    """Let one of our packages also find the modules of the user's package of the same name."""
    for folder in _folders():
        inner = str((folder / package.__name__).resolve())
        if Path(inner).is_dir() and inner not in package.__path__:
            package.__path__.append(inner)


def _own_file(name: str) -> ModuleType | None:
    """The user's own ``name.py`` or ``name/__init__.py``, loaded beside our package of that name."""
    inner = Path(*name.split("."))
    for folder in _folders():
        for path in (folder / f"{inner}.py", folder / inner / "__init__.py"):
            if path.is_file():
                alias = f"{name} of {path.resolve()}"
                if alias not in sys.modules:
                    spec = importlib.util.spec_from_file_location(alias, path.resolve())
                    assert spec is not None and spec.loader is not None
                    sys.modules[alias] = module = importlib.util.module_from_spec(spec)
                    try:
                        spec.loader.exec_module(module)
                    except BaseException:
                        del sys.modules[alias]
                        raise
                return sys.modules[alias]
    return None
