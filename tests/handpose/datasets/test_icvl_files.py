"""handpose/datasets/icvl_files.py: labels, and what is wrong with a copy of the data set"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from handpose.datasets import icvl_files
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs


def test_labels_of_two_sequences(tmp_path: Path) -> None:
    """Frames of the sequences are concatenated; paths are relative to Depth; blank
    lines are skipped.
    """
    joints = np.arange(48) + 50.0
    line = " ".join(f"{value:.3f}" for value in joints)
    for n, path in ((1, "a/image_0000.png"), (2, "/b\\image_0007.png")):
        (tmp_path / f"test_seq_{n}.txt").write_text(f"{path} {line} \n\n")
    files, uvd = icvl_files.read_annotation(
        [tmp_path / "test_seq_1.txt", tmp_path / "test_seq_2.txt"]
    )
    assert files == [tmp_path / "Depth/a/image_0000.png", tmp_path / "Depth/b/image_0007.png"]
    np.testing.assert_array_equal(uvd, np.stack([joints.reshape(16, 3)] * 2))


@bad_inputs(
    DataError,
    {
        "three values": (
            "a.png 1 2 3\n",
            "...labels.txt:1: found 3 values after the path, expected 48 numbers, u v d of 16 joints",
        ),
        "text": (
            "a.png " + "60 " * 48 + "\nb.png " + "x " * 48,
            "...labels.txt:2: found something that is not a number...",
        ),
        "empty": ("", "...: no labels in it..."),
        "x y z": (
            "a.png " + "-300.5 " * 48,
            "...the palm is mostly at -300.5 -300.5 -300.5, expected u v d...",
        ),
    },
)
def test_broken_labels(tmp_path: Path, given: str, rejected: Any) -> None:
    (tmp_path / "labels.txt").write_text(given)
    with rejected:
        icvl_files.read_annotation([tmp_path / "labels.txt"])


FRAME = "a.png " + "60 60 400 " * 16 + "\n"


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the data set with two frames of each sequence."""
    for folder, labels in (("Training", ["labels"]), ("Testing", ["test_seq_1", "test_seq_2"])):
        for name in labels:
            (tmp_path / folder / "Depth" / name).mkdir(parents=True)
            lines = "".join(FRAME.replace("a.png", f"{name}/{n}.png") for n in range(2))
            (tmp_path / folder / f"{name}.txt").write_text(lines)
            for n in range(2):
                image = np.full((240, 320), 400, np.uint16)
                assert cv2.imwrite(str(tmp_path / folder / "Depth" / name / f"{n}.png"), image)
    return tmp_path


def flaws(root: Path, split: str = "test") -> list[tuple[str, bool]]:
    """The problems of a split, and whether each is fatal."""
    return [(flaw.text, flaw.fatal) for flaw in icvl_files.check_split(root, split)[1]]


def test_a_small_copy(copy: Path) -> None:
    whole = "2 labelled frames, the whole training set with its turned copies has over 300,000"
    assert flaws(copy, "train") == [(f"{copy}/Training/labels.txt: {whole}", False)]
    whole = "4 labelled frames, the whole test set has 702 + 894"
    assert flaws(copy) == [(f"{copy}/Testing: {whole}", False)]
    assert icvl_files.check_split(copy, "test")[0] == [
        f"{copy}/Testing: 4 labelled frames, 4 of their depth frames"
    ]


def test_missing_files_are_reported(copy: Path) -> None:
    frame = copy / "Testing" / "Depth" / "test_seq_1" / "1.png"
    frame.unlink()
    missing = "of 4 depth frames are missing, the first is"
    assert flaws(copy)[1:] == [(f"{copy}/Testing: 1 {missing} {frame}", False)]
    (copy / "Testing" / "test_seq_2.txt").unlink()
    gone = "test_seq_2.txt: no such file; the test frames of one of the two sequences are missing"
    assert flaws(copy)[0] == (f"{copy}/Testing/{gone}", False)
    shutil.rmtree(copy / "Testing" / "Depth")
    first = frame.with_name("0.png")
    missing = f"2 of 2 depth frames are missing, the first is {first}; found nothing"
    assert flaws(copy)[1] == (f"{copy}/Testing: {missing}", True)
    first.parent.mkdir(parents=True)
    (first.parent / "rgb.png").touch()
    assert flaws(copy)[1][0].endswith("; found rgb.png")
    (copy / "Testing" / "test_seq_1.txt").unlink()
    assert flaws(copy) == [
        (
            f"{copy}/Testing/test_seq_1.txt: no such file; it holds the joints, and comes with the "
            "folder Depth",
            True,
        )
    ]
    shutil.rmtree(copy / "Testing")
    line = "no folder 'Testing', which holds test_seq_1.txt and Depth; found Training"
    assert flaws(copy) == [(f"{copy}: {line}", True)]


def test_a_damaged_first_frame(copy: Path) -> None:
    """An image of another type is fatal, a damaged one is not."""
    path = copy / "Testing" / "Depth" / "test_seq_1" / "0.png"
    cv2.imwrite(str(path), np.full((240, 320), 200, np.uint8))
    (line, fatal) = flaws(copy)[1]
    assert line.startswith(f"{path}: ") and "expected 16-bit grey" in line and fatal
    path.write_bytes(b"")
    (line, fatal) = flaws(copy)[1]
    assert "truncated, damaged or no PNG" in line and not fatal
