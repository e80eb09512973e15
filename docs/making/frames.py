"""The frames of ``docs/book/nano.py``: the first rendered training frames, small enough to keep."""

from __future__ import annotations

import io
from collections.abc import Iterator

import numpy as np

from docs.making.made import Made
from handpose.synthetic.generator import Generator
from netlib.files.paths import ROOT

CLOSE = 1e-4  # of a joint, in half-cubes
FEW = 1e-3  # of the pixels: a rounding that another processor makes at an edge


def made() -> Iterator[Made]:
    """docs/book/frames.npz: depth (64, 1, 128, 128) in 1/127 of a half-cube, joints (64, 31, 3) in half-cubes."""
    yield Made(ROOT / "docs" / "book" / "frames.npz", _file, _alike)


def _file() -> bytes:
    frames = Generator(seed=0, split="train").block(0)
    depth, joints = np.rint(frames.depth * 127).astype(np.int8), frames.joint.reshape(-1, 31, 3).astype(np.float32)
    file = io.BytesIO()
    np.savez_compressed(file, depth=depth, joints=joints)
    return file.getvalue()


def _alike(there: bytes, wanted: bytes) -> bool:
    """Whether both hold the same joints, and the same pixels but for a few."""
    with np.load(io.BytesIO(there)) as a, np.load(io.BytesIO(wanted)) as b:
        return (
            a["depth"].shape == b["depth"].shape
            and float((a["depth"] != b["depth"]).mean()) <= FEW
            and np.allclose(a["joints"], b["joints"], atol=CLOSE)
        )
