"""Old names of moved modules, with a DeprecationWarning, until the next release.

``netlib.system.aliases`` does the same for netlib, but importing handpose must not import netlib.
"""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import types
import warnings
from collections.abc import Sequence

MOVED = {
    "handpose.fitting.depth": "handpose.depth_fit",
    "handpose.fitting": "handpose.joint_fit",
    "handpose.predicting": "handpose.prediction",
    "handpose.recordings": "handpose.sources",
    "handpose.tracks": "handpose.track_files",
    "handpose.data.nyu_files": "handpose.importers.nyu_files",
    "handpose.data.icvl_files": "handpose.importers.icvl_files",
}  # packages and modules; a longer name comes before its beginning


class OldNames(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Import hook for moved modules and packages. A module is the same object under both names."""

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: types.ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """The spec of an old name, otherwise None."""
        return importlib.machinery.ModuleSpec(name, self) if _place_of(name) else None

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> types.ModuleType:
        """The moved module, with a warning."""
        place = _place_of(spec.name)
        assert place is not None
        text = f"{spec.name} is now {place}; the old name goes with the next release"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        module = importlib.import_module(place)
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module: types.ModuleType) -> None:
        """Restore the module's own spec, which the import system has replaced."""
        assert module.__spec__ is not None
        module.__spec__ = module.__spec__.loader_state


def _place_of(name: str) -> str | None:
    """The new name of a module; None if it has not moved."""
    for old, new in MOVED.items():
        if name == old or name.startswith(f"{old}."):
            return new + name.removeprefix(old)
    return None
