"""Who may import whom: netlib, then layers, then handpose, then tools; and every file says what it is."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
ORDER = ["netlib", "layers", "handpose", "tools"]  # each may import itself and what stands before it
CORE = {"numpy", "scipy", "cv2", "h5py"}
# Shared mathematics, not layer types: the skeleton, and fast ways to compute one layer
SHARED_BY_LAYERS = {"kinematics", "row_tiles", "window_tiles", "max_tiles"}
FILES = sorted(path for package in ORDER for path in (ROOT / package).rglob("*.py"))
names = pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))


def imports(path: Path) -> set[str]:
    """Full names of all that a file imports, wherever in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def test_the_packages_are_found() -> None:
    """The other tests have something to look at."""
    assert len(FILES) > 50


@names
def test_arrows_point_down(path: Path) -> None:
    """No package imports one above it."""
    package = path.relative_to(ROOT).parts[0]
    above = ORDER[ORDER.index(package) + 1 :]
    assert not {name for name in imports(path) if name.split(".")[0] in above}


@names
def test_only_the_core_packages_are_needed(path: Path) -> None:
    """netlib and layers run with numpy, scipy, cv2 and h5py."""
    if path.relative_to(ROOT).parts[0] in ("netlib", "layers"):
        outside = {name.split(".")[0] for name in imports(path)} - set(sys.stdlib_module_names) - set(ORDER)
        assert outside <= CORE


@pytest.mark.parametrize("path", sorted((ROOT / "layers").glob("*.py")), ids=lambda path: path.stem)
def test_layers_do_not_import_layers(path: Path) -> None:
    """A layer can be read without opening another one."""
    if path.stem != "__init__":
        others = {name.split(".")[1] for name in imports(path) if name.startswith("layers.")}
        assert others <= SHARED_BY_LAYERS


def test_netlib_loads_the_layers_in_one_place() -> None:
    """By name, at the first look-up."""
    users = [path.name for path in (ROOT / "netlib").glob("*.py") if 'import_module("layers")' in path.read_text()]
    assert users == ["layer.py"]


@names
def test_every_file_opens_with_a_docstring(path: Path) -> None:
    """What it is, before anything else."""
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))), path
