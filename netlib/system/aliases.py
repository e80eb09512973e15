"""Module aliases: ``caffe`` for netlib.caffe, and the old names of moved modules."""

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
    """Import hook that resolves ``name`` and ``name.x.y`` to the modules ``target`` and ``target.x.y``."""

    def __init__(self, name: str, target: str) -> None:
        self.name, self.target = name, target

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Spec of ``name``, if it belongs to the alias and its target exists."""
        if name != self.name and not name.startswith(f"{self.name}."):
            return None
        if importlib.util.find_spec(self._target_of(name)) is None:
            return None
        return importlib.machinery.ModuleSpec(name, self)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> types.ModuleType:
        """Import and return the target."""
        module = importlib.import_module(self._target_of(spec.name))
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: types.ModuleType) -> None:
        """Restore the module's own spec, which the import system has replaced by that of the alias."""
        assert module.__spec__ is not None
        module.__spec__ = module.__spec__.loader_state

    def _target_of(self, name: str) -> str:
        return self.target + name.removeprefix(self.name)


class OldNames(Alias):
    """Import hook that resolves the old names of moved modules, with a DeprecationWarning.

    moved  old name -> new name
    """

    def __init__(self, moved: Mapping[str, str]) -> None:
        super().__init__("", "")
        self.moved = moved

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Spec of a module under its old name."""
        return importlib.machinery.ModuleSpec(name, self) if name in self.moved else None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> types.ModuleType:
        """Import and return the moved module, with a warning."""
        text = f"{spec.name} is now {self.moved[spec.name]}; the old name will be removed in the next release"
        # stacklevel 2 is the import statement: Python skips its own frames
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        return super().create_module(spec)

    def _target_of(self, name: str) -> str:
        return self.moved[name]


def install(name: str, target: str) -> bool:
    """Make ``name`` an alias of ``target`` in this process, even if ``name`` is installed. False if it already is."""
    if any(isinstance(finder, Alias) and finder.name == name for finder in sys.meta_path):
        return False
    for known in [known for known in sys.modules if known == name or known.startswith(f"{name}.")]:
        del sys.modules[known]
    sys.meta_path.insert(0, Alias(name, target))
    return True


def keep_old_names(moved: Mapping[str, str]) -> None:
    """Keep the old names of moved modules importable, with a DeprecationWarning."""
    sys.meta_path.append(OldNames(moved))


def is_installed(name: str, attribute: str) -> bool:
    """Whether Python would find a package ``name``; if it is loaded, whether it has the attribute."""
    if name in sys.modules:
        return hasattr(sys.modules[name], attribute)
    found = importlib.util.find_spec(name)  # must be a package, not a single file or a folder without __init__.py
    return found is not None and found.origin is not None and bool(found.submodule_search_locations)
