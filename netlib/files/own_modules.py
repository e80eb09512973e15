"""This project's packages ``layers`` and ``fast``, also where a script has modules of these names,
and ``caffe``.

Scripts written for Caffe often have their own ``layers``. ``own_module`` returns ours whatever else
is imported under its name; where a script has its own, ours are in sys.modules only while one of
our modules is imported (``in_place``), also a module of handpose (``guard``). After ``yield_names``
(netlib.install_as_caffe) this holds for every script, and an import of these names finds the
script's own module first, even if this project's folder comes first in sys.path. It finds ours if
there is no other, so that ours need no other name.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from types import ModuleType

from netlib.files.paths import BASE, ROOT, load_module, own

NAMES = ("layers", "fast")
# Folders of a clone that netlib does not import.
OTHERS = ("tools", "export", "exercises", "experiments", "models")
_known: dict[str, ModuleType] = {}  # results of own_module
_aside: dict[str, ModuleType] = {}  # our modules that are not in sys.modules, by name
_lock = threading.RLock()
_depth = [0]  # of in_place


def own_module(name: str) -> ModuleType:
    """Return the module ``name`` of this project, imported once."""
    if name not in _known:
        with in_place():
            top = name.partition(".")[0]
            load_module(top, own(top) / "__init__.py")
            _known[name] = importlib.import_module(name)
    return _known[name]


def yield_names(names: Iterable[str] = NAMES) -> None:
    """From now on, imports of these names and of ``OTHERS`` find a script's own modules first, and
    ours, as far as they have been imported, if there are no others.
    """
    for top in names:
        if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
            sys.meta_path.insert(0, _Finder())
        if is_ours(sys.modules.get(top)):
            _aside.update(_take(top))


def take_caffe() -> None:
    """From now on, ``import caffe`` returns netlib.caffe, even if Caffe is
    installed or imported.
    """
    if not any(isinstance(finder, _Caffe) for finder in sys.meta_path):
        _take("caffe")
        sys.meta_path.insert(0, _Caffe())


def has_caffe() -> bool:
    """Whether Python would find a package ``caffe``; if one is loaded, whether it has nets."""
    if "caffe" in sys.modules:
        return hasattr(sys.modules["caffe"], "Net")
    # must be a package, not a single file or a folder without __init__.py
    found = importlib.util.find_spec("caffe")
    return found is not None and found.origin is not None and bool(found.submodule_search_locations)


def guard(package: str) -> None:
    """From now on, import the modules of a package of this project with our ``NAMES`` in place."""
    sys.meta_path.insert(0, _Guard(package))


@functools.lru_cache(maxsize=16)
def _has_theirs(top: str, inside: tuple[str, ...]) -> bool:
    """Whether one of these folders has a module ``top``, other than a folder
    without __init__.py.
    """
    found = importlib.machinery.PathFinder.find_spec(top, inside)
    return found is not None and found.origin is not None and _has_code(found)


def folders() -> list[str]:
    """The folders of sys.path without this project's."""
    return [
        folder for folder in dict.fromkeys(sys.path) if Path(folder).resolve() not in (ROOT, BASE)
    ]


@contextlib.contextmanager
def in_place() -> Iterator[None]:
    """Context manager: our packages, as far as they are imported, are in sys.modules, in
    place of others.
    """
    with _lock:
        displaced = [
            top
            for top in NAMES
            if top in _aside or (top in sys.modules and not is_ours(sys.modules[top]))
        ]
        theirs = {name: module for top in displaced for name, module in _take(top).items()}
        sys.modules.update(_aside)
        _depth[0] += 1
        try:
            yield
        finally:
            _depth[0] -= 1
            for top in displaced:
                _aside.update(_take(top))
            sys.modules.update(theirs)
            if not _depth[0]:
                yield_names(
                    top
                    for top in NAMES
                    if top not in displaced and _has_theirs(top, tuple(folders()))
                )


def _take(top: str) -> dict[str, ModuleType]:
    """Remove the module ``top`` and those below it from sys.modules, and return them."""
    return {
        name: sys.modules.pop(name) for name in list(sys.modules) if name.partition(".")[0] == top
    }


def is_ours(module: ModuleType | None) -> bool:
    """Whether a module, if any, is a package of this project."""
    if module is None:
        return False
    return str(own(module.__name__)) in list(getattr(module, "__path__", []))


class _Guard(importlib.abc.MetaPathFinder):
    """Import hook for the modules of one of our packages."""

    def __init__(self, package: str) -> None:
        self._package = package

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Spec of a module of the package, which ``_InPlace`` imports."""
        if name.partition(".")[0] != self._package:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path)
        if spec is not None and isinstance(spec.loader, importlib.machinery.SourceFileLoader):
            spec.loader = _InPlace(spec.loader.name, spec.loader.path)
        return spec


class _InPlace(importlib.machinery.SourceFileLoader):
    """Executes a module with our packages in sys.modules."""

    def exec_module(self, module: ModuleType) -> None:
        """Execute the module."""
        own_module("layers")
        with in_place():
            super().exec_module(module)


class _Finder(importlib.abc.MetaPathFinder):
    """Import hook that finds a script's own modules before ours, and ours if there are none."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Spec of the script's own module, or of ours that is set aside."""
        top, _, inner = name.partition(".")
        if _depth[0]:  # ours are in sys.modules, so what is imported below them is found there
            return None
        if top not in NAMES + OTHERS or (inner and not is_ours(sys.modules.get(top))):
            return None
        if not inner:
            theirs = importlib.machinery.PathFinder.find_spec(name, folders())
            if theirs is not None and _has_code(theirs):
                return theirs
        elif top in NAMES and name not in _aside:
            # not imported before the names were yielded
            with in_place(), contextlib.suppress(ModuleNotFoundError):
                importlib.import_module(name)
        if name not in _aside:
            return None
        module = _aside[name]
        return importlib.machinery.ModuleSpec(name, _Existing(lambda: module))


class _Caffe(importlib.abc.MetaPathFinder):
    """Import hook that resolves ``caffe`` and ``caffe.x.y`` to netlib.caffe and its modules."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Spec of a module of netlib.caffe, or of one that a folder on sys.path has.

        Forks add modules to the package caffe; those of a fork's python/caffe that a script has on
        its path are found.
        """
        if name.partition(".")[0] != "caffe":
            return None
        ours = f"netlib.{name}"
        with contextlib.suppress(ModuleNotFoundError):  # of a package that only the fork has
            if importlib.util.find_spec(ours) is not None:
                return importlib.machinery.ModuleSpec(
                    name, _Existing(functools.partial(importlib.import_module, ours))
                )
        package = Path(*name.split(".")[:-1])
        return importlib.machinery.PathFinder.find_spec(
            name, [str(folder / package) for folder in map(Path, sys.path)]
        )


class _Existing(importlib.abc.Loader):
    """Gives an import a module that exists, maybe under another name."""

    def __init__(self, module: Callable[[], ModuleType]) -> None:
        self._module = module

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        """Return the module."""
        module = self._module()
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        """Restore the module's own spec, which the import system has replaced."""
        assert module.__spec__ is not None
        module.__spec__ = module.__spec__.loader_state


def _has_code(spec: importlib.machinery.ModuleSpec) -> bool:
    """Whether a spec is that of a module, or of a folder without __init__.py that holds
    modules, and not ours.
    """
    if spec.origin is not None:
        return Path(spec.origin).resolve() != own(spec.name).resolve() / "__init__.py"
    places = [Path(folder).resolve() for folder in spec.submodule_search_locations or []]
    return any(any(place.glob("*.py")) and not place.is_relative_to(ROOT) for place in places)
