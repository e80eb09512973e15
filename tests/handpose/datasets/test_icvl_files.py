"""handpose/datasets/icvl_files.py; more of it in the tests of the tools that use it"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from handpose.datasets import icvl_files
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs


def test_labels_of_two_sequences(tmp_path: Path) -> None:
    """Frames of the sequences are concatenated; paths are relative to Depth; blank lines are skipped."""
    joints = np.arange(48) + 50.0
    line = " ".join(f"{value:.3f}" for value in joints)
    for n, path in ((1, "a/image_0000.png"), (2, "/b\\image_0007.png")):
        (tmp_path / f"test_seq_{n}.txt").write_text(f"{path} {line} \n\n")
    files, uvd = icvl_files.read_annotation([tmp_path / "test_seq_1.txt", tmp_path / "test_seq_2.txt"])
    assert files == [tmp_path / "Depth/a/image_0000.png", tmp_path / "Depth/b/image_0007.png"]
    np.testing.assert_array_equal(uvd, np.stack([joints.reshape(16, 3)] * 2))


@bad_inputs(DataError, {
    "three values": ("a.png 1 2 3\n",
                     "...labels.txt:1: found 3 values after the path, expected 48 numbers, u v d of 16 joints"),
    "text": ("a.png " + "60 " * 48 + "\nb.png " + "x " * 48,
             "...labels.txt:2: found something that is not a number..."),
    "empty": ("", "...: no labels in it..."),
    "x y z": ("a.png " + "-300.5 " * 48, "...the palm is mostly at -300.5 -300.5 -300.5, expected u v d..."),
})
def test_broken_labels(tmp_path: Path, given: str, rejected: Any) -> None:
    """The error names the line of the file and what is wrong with it."""
    (tmp_path / "labels.txt").write_text(given)
    with rejected:
        icvl_files.read_annotation([tmp_path / "labels.txt"])
