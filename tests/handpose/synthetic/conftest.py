"""Frames shared by several test files."""

from __future__ import annotations

import pytest

from handpose.datasets.frames import Frames
from handpose.synthetic.generator import Generator
from handpose.synthetic.pose_prior import BodySampler


@pytest.fixture(scope="module")
def generator() -> Generator:
    """The default generator."""
    return Generator(seed=7)


@pytest.fixture(scope="module")
def frames(generator: Generator) -> Frames:
    """Its first block of frames."""
    return generator.block(0)


@pytest.fixture(scope="module")
def sampler() -> BodySampler:
    """The default sampler."""
    return BodySampler()
