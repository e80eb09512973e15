"""Module aliases: ``caffe`` for netlib.caffe."""

from __future__ import annotations

import contextlib
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
import types
from collections.abc import Sequence
from pathlib import Path


class Alias(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Import hook that resolves ``name`` and ``name.x.y`` to the modules ``target`` and ``target.x.y``."""

    def __init__(self, name: str, target: str) -> None:
        self.name, self.target = name, target

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Spec of ``name``, if it belongs to the alias and its target exists, or a folder on sys.path has it.

        Forks add modules to the package caffe; those of a fork's python/caffe that a script has on its path are found.
        """
        if name != self.name and not name.startswith(f"{self.name}."):
            return None
        with contextlib.suppress(ModuleNotFoundError):  # of a package that only the fork has
            if importlib.util.find_spec(self._target_of(name)) is not None:
                return importlib.machinery.ModuleSpec(name, self)
        package = Path(*name.split(".")[:-1])
        return importlib.machinery.PathFinder.find_spec(name, [str(folder / package) for folder in map(Path, sys.path)])

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


def install(name: str, target: str) -> bool:
    """Make ``name`` an alias of ``target`` in this process, even if ``name`` is installed. False if it already is."""
    if any(isinstance(finder, Alias) and finder.name == name for finder in sys.meta_path):
        return False
    for known in [known for known in sys.modules if known == name or known.startswith(f"{name}.")]:
        del sys.modules[known]
    sys.meta_path.insert(0, Alias(name, target))
    return True


def is_installed(name: str, attribute: str) -> bool:
    """Whether Python would find a package ``name``; if it is loaded, whether it has the attribute."""
    if name in sys.modules:
        return hasattr(sys.modules[name], attribute)
    found = importlib.util.find_spec(name)  # must be a package, not a single file or a folder without __init__.py
    return found is not None and found.origin is not None and bool(found.submodule_search_locations)
