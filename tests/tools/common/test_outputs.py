"""tools/common/outputs.py: outputs that cannot be written or would overwrite an input are reported before the work."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from layers.hand.skeleton import NYU_HAND
from netlib.errors import NetlibError
from tests.support.hdf5_files import write_hdf5
from tests.support.running import run_tool
from tools.common import outputs


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make a folder with a file, a link to it and an empty folder the working directory."""
    monkeypatch.chdir(tmp_path)
    Path("a.txt").write_text("mine")
    Path("link.txt").symlink_to("a.txt")
    Path("inner").mkdir()


@pytest.mark.parametrize("out", ["a.txt", "./a.txt", "inner/../a.txt", "link.txt"])
def test_an_input_by_whatever_name(out: str) -> None:
    """An output that is also an input is rejected under any of its names."""
    for check in (outputs.refuse_inputs, outputs.check_place):
        with pytest.raises(NetlibError, match=r"txt: is read in this run; expected another output"):
            check(Path(out), [None, "b.txt", "a.txt"])
        check(Path(out), [None, "b.txt"])
    assert Path("a.txt").read_text() == "mine"


@pytest.mark.parametrize(
    ("out", "said"),
    [("none/b.txt", "none/b.txt: folder none does not exist"), ("inner", "Is a directory"), ("", "Is a directory"),
     ("/", "Is a directory"), ("a.txt/b", "folder a.txt does not exist")],
)
def test_places_where_no_file_can_be(out: str, said: str) -> None:
    """Impossible places raise an error, and the check leaves no file."""
    with pytest.raises((NetlibError, OSError), match=said):
        outputs.check_place(Path(out))
    outputs.check_place(Path("inner/b.txt"))
    assert sorted(path.name for path in Path().rglob("*")) == ["a.txt", "inner", "link.txt"]


@pytest.mark.parametrize(
    ("tool", "argv"),
    [
        ("export_onnx", ["net.prototxt", "a.txt", "a.txt"]),
        ("export_onnx", ["a.txt", "w.h5", "link.txt"]),
        ("fit_pose", ["joints.txt", "--out", "joints.txt"]),
        ("fit_pose", ["joints.txt", "--skeleton", "hand.prototxt", "--out", "hand.prototxt"]),
        ("fit_pose", ["list.txt", "--out", "."]),
        ("show_data", ["crops", "--out", "crops/0.png"]),
        ("show_data", ["crops", "--frames", "2", "--out", "crops/1.png"]),
        ("show_data", ["list.png", "--out", "list.png"]),
        ("show_data", ["list.png", "--out", "deep/crops.png"]),
    ],
)
def test_tools(tool: str, argv: list[str]) -> None:
    """Each tool rejects an output that is an input on one line and changes no file."""
    for name in ("net.prototxt", "w.h5", "b.png"):
        Path(name).write_text("never read")
    Path("hand.prototxt").write_bytes(NYU_HAND.read_bytes())
    Path("joints.txt").write_text(" ".join(["100 100 800"] * 14))
    for folder in ("deep", "crops"):
        Path(folder).mkdir()
    for name in ("crops.h5", "deep/crops.h5", "deep/crops.png"):
        write_hdf5(
            name, depth=np.zeros((60, 1, 4, 4), np.float32), joint=np.random.default_rng(0).uniform(-0.5, 0.5, (60, 93))
        )
    Path("list.txt").write_text("deep/crops.h5\n")
    Path("list.png").write_text("deep/crops.png\n")
    for n in range(3):
        cv2.imwrite(f"crops/{n}.png", np.full((128, 128), 127, np.uint8))
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    (line,) = run_tool(tool, *argv, status=1).err.splitlines()
    assert line.endswith(": is read in this run; expected another output")
    assert {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()} == before
