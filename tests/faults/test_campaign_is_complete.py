"""Every reader has a campaign: every module that opens a file for reading is in the table of readers.py."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.faults.readers import READERS

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [
    path
    for package in ("netlib", "layers", "fast", "handpose", "exercises", "experiments", "export", "tools")
    for path in (ROOT / package).rglob("*.py")
]
NO_READERS = {
    "fast/blas.py": "reads what Linux says of the processor and of loaded libraries",
    "experiments/confidence.py": "reads labels with np.load, and looks at their shape",
    "experiments/table1/results.py": "asks netlib/files/hdf5.py for rows, and looks at their shape",
    "handpose/__main__.py": "reads the commands that come with the project",
    "handpose/output/drawing/page/assembly.py": "reads the page that comes with the project",
    "handpose/frames/formats/video_writer.py": "looks whether a frame of what it has written itself reached the disk",
    "netlib/system/memory.py": "reads what Linux says of the memory that there is",
    "netlib/files/reading.py": "opens for all others what a user names",
    "netlib/files/locks.py": "opens a file to lock it, and reads the number of the process that has it",
    "netlib/building/python_layer.py": "reads the text of a Python layer, which is code",
    "tools/common/databases.py": "opens the database that it makes",
    "exercises/network.py": "reads the net that comes with the project",
    "exercises/check.py": "reads the text of a solution, which is code",
    "exercises/recorded.py": "reads numbers that come with the project",
    "exercises/exercise.py": "reads the project's own source",
    "tools/common/caffe_log.py": "opens the log that it writes",
    "tools/docs.py": "reads the pages that come with the project",
    "tools/export_onnx.py": "reads back what it has just written",
    "tools/record.py": "opens recordings by handpose.frames.opening",
    "tools/common/campaign.py": "asks netlib/files/hdf5.py how many rows there are",
    "tools/track.py": "opens recordings by handpose.frames.opening",
    "tools/package_model.py": "reads back what it has just written",
}
# Names of functions that open files; for those that also write, the mode is checked.
BY_NAME = {
    "read_bytes",
    "read_pieces",
    "read_text",
    "opened",
    "Source",
    "loadmat",
    "whosmat",
    "imread",
    "fromfile",
    "loadtxt",
    "genfromtxt",
    "memmap",
}
BY_MODE = {"open", "File"}
OF_NUMPY = {"load"}


def opening(tree: ast.AST) -> Iterator[int]:
    """Yield the numbers of the lines that open a file for reading."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        owner = getattr(getattr(node.func, "value", None), "id", "")
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        if name in BY_NAME or (name in OF_NUMPY and owner in ("np", "numpy")) or (name in BY_MODE and reads(node)):
            yield node.lineno


def reads(call: ast.Call) -> bool:
    """Whether the mode is for reading only; "r+b" changes a file in place and is not."""
    words = [*call.args, *(word.value for word in call.keywords if word.arg == "mode")]
    modes = [word.value for word in words if isinstance(word, ast.Constant) and isinstance(word.value, str)]
    flags = [node.attr for word in words for node in ast.walk(word) if isinstance(node, ast.Attribute)]
    return not any(set(mode) & set("wax+") and len(mode) < 4 for mode in modes) and not {"O_WRONLY", "devnull"} & set(
        flags
    )


@pytest.mark.parametrize(
    ("line", "is_reader"),
    [
        ("open(path)", True),
        ('open(path, "rb")', True),
        ('open(path, mode="w")', False),
        ('path.open("r+b")', False),
        ("path.open(encoding='utf-8')", True),
        ("os.open(path, os.O_WRONLY | os.O_CREAT)", False),
        ("os.open(os.devnull, os.O_RDWR)", False),
        ("path.read_text(encoding='utf-8')", True),
        ("path.write_text('w')", False),
        ("h5py.File(path, 'r')", True),
        ("h5py.File(path, 'w')", False),
        ("np.load(path, allow_pickle=False)", True),
        ("skeleton.load(path)", False),
        ("lmdb.open(str(path), readonly=True)", True),
        ("files.read_bytes(path, 'the net')", True),
        ("hdf5.opened(path)", True),
        ("Source(path, 'the database')", True),
    ],
)
def test_what_opens_a_file(line: str, is_reader: bool) -> None:
    """A call that opens a file for reading is recognized by the function's name and the mode."""
    assert bool(list(opening(ast.parse(line)))) == is_reader


def test_every_reader_has_a_campaign() -> None:
    """A module that opens files is in a row of the table, or in the exceptions with a reason."""
    found = {
        str(path.relative_to(ROOT)): list(opening(ast.parse(path.read_text(encoding="utf-8")))) for path in SOURCES
    }
    places = {f"{module}:{lines[0]}" for module, lines in found.items() if lines and module not in known()}
    assert places == set(), "add a row to READERS in tests/faults/readers.py, or a reason to NO_READERS"


def test_the_table_names_no_module_that_reads_nothing() -> None:
    """Every module in the table reads files."""
    for module in known():
        assert list(opening(ast.parse((ROOT / module).read_text(encoding="utf-8")))), module


def known() -> set[str]:
    """The modules in the table and the exceptions."""
    return {module for reader in READERS for module in reader.modules} | set(NO_READERS)
