"""docs/making/symbols.py: the lines of definitions."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.making.symbols import line_of

PYTHON = '''"""A module."""

LIMIT: float = 1.0
SMALL = LARGE = 2


@decorated
def free() -> None:
    def inner() -> None: ...


class Box:
    side = 1

    @property
    def volume(self) -> int: ...


class Bag:
    side = 3
'''
PROTOTXT = """# A net.
base_lr: 0.1
layer {
  name: "fc1" type: "InnerProduct"
  inner_product_param {
    num_output: 3
  }
}
layer { name: "fc2" inner_product_param { num_output: 4 } }
layer { name: "twice" }
layer { name: "twice" }
"""


@pytest.fixture()
def folder(tmp_path: Path) -> Path:
    """A folder with a Python file and a prototxt."""
    (tmp_path / "a.py").write_text(PYTHON)
    (tmp_path / "a.prototxt").write_text(PROTOTXT)
    return tmp_path


@pytest.mark.parametrize(
    ("file", "wanted", "line"),
    [
        ("a.py", "LIMIT", 3),
        ("a.py", "LARGE", 4),
        ("a.py", "free", 8),
        ("a.py", "Box", 12),
        ("a.py", "Box.volume", 16),
        ("a.py", "Bag.side", 20),
        ("a.prototxt", "base_lr", 2),
        ("a.prototxt", "fc1", 3),
        ("a.prototxt", "fc1.num_output", 6),
        ("a.prototxt", "fc2.num_output", 9),
    ],
)
def test_lines(folder: Path, file: str, wanted: str, line: int) -> None:
    """A definition's line excludes its decorators, a layer's is its first; of equal fields, the named layer's."""
    assert line_of(folder / file, wanted) == line


@pytest.mark.parametrize(
    ("file", "wanted", "message"),
    [
        ("a.py", "box", "a.py has no box"),
        ("a.py", "inner", "a.py has no inner"),
        ("a.py", "free.inner", "a.py has no free.inner"),
        ("a.py", "Bag.volume", "a.py has no Bag.volume"),
        ("a.prototxt", "fc3", "a.prototxt has no fc3"),
        ("a.prototxt", "fc1.num_input", "a.prototxt has no fc1.num_input"),
        ("a.prototxt", "base_lr.x", "a.prototxt has no base_lr.x"),
        ("a.prototxt", "twice", "a.prototxt has 2 twice"),
    ],
)
def test_names_that_are_not_there(folder: Path, file: str, wanted: str, message: str) -> None:
    """Names inside functions, missing names, and names of two layers are errors."""
    with pytest.raises(ValueError) as caught:
        line_of(folder / file, wanted)
    assert str(caught.value) == message
