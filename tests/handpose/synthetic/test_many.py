"""handpose/synthetic/files.py"""

from __future__ import annotations

import numpy as np

from handpose.datasets.frames import Frames
from handpose.synthetic.files import generate
from handpose.synthetic.generator import BLOCK, Generator
from tests.handpose.synthetic.same_frames import assert_equal


def test_generate_cuts_anywhere(generator: Generator, frames: Frames) -> None:
    """Frames of any range, across blocks, equal those of the blocks."""
    pieces = list(generate(BLOCK, generator, start=BLOCK // 2))
    assert [len(piece) for piece in pieces] == [BLOCK // 2, BLOCK // 2]
    np.testing.assert_array_equal(pieces[0].depth, frames.depth[BLOCK // 2 :])
    np.testing.assert_array_equal(np.concatenate([p.index for p in pieces]), np.arange(BLOCK // 2, BLOCK * 3 // 2))
    (few,) = generate(3, generator)
    np.testing.assert_array_equal(few.joint, frames.joint[:3])
    assert not list(generate(0, generator))


def test_workers_change_nothing(generator: Generator) -> None:
    """Two processes draw the same frames in the same order as one."""
    count = 2 * BLOCK + 5
    for one, two in zip(generate(count, generator), generate(count, generator, workers=2), strict=True):
        assert_equal(one, two)
