"""handpose/sources/npz_file.py: one array frame by frame, the small ones whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from handpose.sources import npz_file
from handpose.sources.npz_file import NpzFile


def test_frame_by_frame(tmp_path: Path) -> None:
    """Compressed or not."""
    depth = np.arange(24, dtype=np.uint16).reshape(2, 3, 4)
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", depth=depth)
        file = NpzFile(tmp_path / "a.npz")
        name, header = file.stack()
        assert (name, header.shape) == ("depth", (2, 3, 4))
        np.testing.assert_array_equal(list(file.frames(name, header)), depth)


def test_small_arrays(tmp_path: Path, monkeypatch) -> None:
    """Of numbers and texts; large ones are nobody's camera, objects nobody's at all."""
    monkeypatch.setattr(npz_file, "SMALL", 200)
    np.savez(tmp_path / "a.npz", depth=np.zeros((2, 3, 4)), fx=60.0, camera="{}", large=np.zeros(1000),
             objects=np.array([None]))  # fmt: skip
    assert sorted(NpzFile(tmp_path / "a.npz").small()) == ["camera", "fx"]
