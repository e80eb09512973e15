"""One package under the name of another: ``caffe`` for netlib.caffe, old names of modules for new ones."""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
import types
import warnings
from collections.abc import Mapping, Sequence


class Alias(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finds ``name`` and ``name.x.y`` as ``target`` and ``target.x.y``: the same modules."""

    def __init__(self, name: str, target: str) -> None:
        self.name, self.target = name, target

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """The specification of ``name``, if it is one of the alias's and its target exists."""
        if name != self.name and not name.startswith(f"{self.name}."):
            return None
        if importlib.util.find_spec(self._target_of(name)) is None:
            return None
        return importlib.machinery.ModuleSpec(name, self)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> types.ModuleType:
        """The target itself."""
        module = importlib.import_module(self._target_of(spec.name))
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: types.ModuleType) -> None:
        """Give the module its own spec back: the import system has put the alias's there."""
        assert module.__spec__ is not None
        module.__spec__ = module.__spec__.loader_state

    def _target_of(self, name: str) -> str:
        return self.target + name.removeprefix(self.name)


class OldNames(Alias):
    """Finds modules that have moved, by their old names, with a DeprecationWarning.

    moved  old name -> new name
    """

    def __init__(self, moved: Mapping[str, str]) -> None:
        super().__init__("", "")
        self.moved = moved

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """The specification of a module by its old name."""
        return importlib.machinery.ModuleSpec(name, self) if name in self.moved else None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> types.ModuleType:
        """The moved module, with a warning."""
        text = f"{spec.name} is now {self.moved[spec.name]}; the old name goes with the next release"
        warnings.warn(
            text, DeprecationWarning, stacklevel=2
        )  # of the import statement: Python leaves its own frames out
        return super().create_module(spec)

    def _target_of(self, name: str) -> str:
        return self.moved[name]


def install(name: str, target: str) -> bool:
    """From now on ``name`` is ``target`` in this process, whatever else is installed; False if it was before."""
    if any(isinstance(finder, Alias) and finder.name == name for finder in sys.meta_path):
        return False
    for known in [known for known in sys.modules if known == name or known.startswith(f"{name}.")]:
        del sys.modules[known]
    sys.meta_path.insert(0, Alias(name, target))
    return True


def keep_old_names(moved: Mapping[str, str]) -> None:
    """Let modules that have moved be imported by their old names, with a DeprecationWarning."""
    sys.meta_path.append(OldNames(moved))


def is_installed(name: str, attribute: str) -> bool:
    """Is there a package ``name`` that Python would find, or a loaded one that has the attribute?"""
    if name in sys.modules:
        return hasattr(sys.modules[name], attribute)
    found = importlib.util.find_spec(name)  # a package with code in it, no mere file or folder of this name
    return found is not None and found.origin is not None and bool(found.submodule_search_locations)


def lend_text_format(target: str) -> None:
    """Let ``google.protobuf.text_format`` be ``target`` where the package protobuf is missing."""
    try:
        importlib.import_module("google.protobuf.text_format")
    except ImportError:
        text_format = importlib.import_module(target)
        google = sys.modules.setdefault("google", types.ModuleType("google"))
        protobuf = sys.modules.setdefault("google.protobuf", types.ModuleType("google.protobuf"))
        google.protobuf, protobuf.text_format = protobuf, text_format  # type: ignore[attr-defined]
        sys.modules["google.protobuf.text_format"] = text_format
