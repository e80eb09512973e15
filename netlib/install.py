"""Let ``import caffe`` find netlib.caffe, once for a whole process."""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
import types
from collections.abc import Sequence


class _Alias(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds ``caffe`` and ``caffe.x.y`` as ``netlib.caffe`` and ``netlib.caffe.x.y``: the same modules."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if name != "caffe" and not name.startswith("caffe."):
            return None
        if importlib.util.find_spec(f"netlib.{name}") is None:
            return None
        return importlib.machinery.ModuleSpec(name, self)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> types.ModuleType:
        module = importlib.import_module(f"netlib.{spec.name}")
        self._spec = module.__spec__
        return module

    def exec_module(self, module: types.ModuleType) -> None:
        module.__spec__ = self._spec  # the import system has put the alias's there


def install_as_caffe() -> None:
    """From now on ``import caffe`` gives netlib.caffe in this process, whatever else is installed.

    Where the package protobuf is missing, ``from google.protobuf import text_format`` gives one that knows caffe_pb2's
    messages.
    """
    if not any(isinstance(finder, _Alias) for finder in sys.meta_path):
        for name in [name for name in sys.modules if name == "caffe" or name.startswith("caffe.")]:
            del sys.modules[name]
        sys.meta_path.insert(0, _Alias())
        _lend_text_format()


def install_if_missing() -> None:
    """The same, unless a Caffe is installed that Python would find."""
    if "caffe" in sys.modules:
        is_there = hasattr(sys.modules["caffe"], "Net")
    else:
        found = importlib.util.find_spec("caffe")  # a package with code in it, no mere file or folder of this name
        is_there = found is not None and found.origin is not None and bool(found.submodule_search_locations)
    if not is_there:
        install_as_caffe()


def _lend_text_format() -> None:
    try:
        importlib.import_module("google.protobuf.text_format")
    except ImportError:
        text_format = importlib.import_module("netlib.caffe.proto.text_format")
        google = sys.modules.setdefault("google", types.ModuleType("google"))
        protobuf = sys.modules.setdefault("google.protobuf", types.ModuleType("google.protobuf"))
        google.protobuf, protobuf.text_format = protobuf, text_format  # type: ignore[attr-defined]
        sys.modules["google.protobuf.text_format"] = text_format
