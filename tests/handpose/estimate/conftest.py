"""Nets for predictions, and depth images of hands for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

import netlib
from handpose.body.nyu import CUBE_MM
from handpose.estimate.finder import Finder, FoundHand
from handpose.estimate.hand import MIN_PRESENCE
from handpose.frames.cameras import KINECT2, Camera
from handpose.sequences.recordings import render_image
from handpose.synthetic.pose_prior import BodySampler
from tests.handpose.drawn_hands import ARM_BEHIND, capsules_of
from tests.support.packaged_hand import EXACT

NET = """
layer { name: "in" type: "Input" top: "depth" input_param { shape { dim: %d dim: 1 dim: 128 dim: 128 } } }
layer { name: "DoF" type: "InnerProduct" bottom: "depth" top: "DoF"
        inner_product_param { num_output: 47 weight_filler { type: "gaussian" std: 0.003 } } }
layer { name: "hand" type: "HandModel" bottom: "DoF" top: "pred"
        hand_model_param { skeleton: "prototxt/hand/people.prototxt" } }
"""
NetOf = Callable[..., netlib.Net]


@pytest.fixture
def seeing(net_of: NetOf) -> netlib.Net:
    """A net whose joints depend on every pixel."""
    return net_of(NET % 1, netlib.TEST)


@pytest.fixture
def fixed(net_of: NetOf) -> Callable[..., netlib.Net]:
    """A net that predicts the same hand in every crop, at its place in training crops plus
    an offset in mm.
    """

    def make(*beside: float) -> netlib.Net:
        prior = EXACT.but(center_jitter=0, center_jitter_wide=0)
        inputs = BodySampler(prior).draw(np.random.default_rng(0), 1).inputs[0]
        inputs[:3] += np.array(beside) / (CUBE_MM / 2)
        net = net_of(NET % 1, netlib.TEST)
        net.params["DoF"][0].data[...], net.params["DoF"][1].data[...] = 0, inputs
        return net

    return make


@pytest.fixture(scope="module")
def frame() -> np.ndarray:
    """Depth (424, 512) in mm of a hand about 700 mm in front of a Kinect v2, with a
    wall behind it.
    """
    sampler, rng = BodySampler(EXACT), np.random.default_rng(3)
    hand = sampler.draw(rng, 1)
    surface = capsules_of(sampler, rng, hand, (30, -20, 700), ARM_BEHIND)
    return render_image(surface, KINECT2, background=1500.0)[0]


def some_crop() -> np.ndarray:
    """Noise in [-1, 1]."""
    return np.random.default_rng(0).uniform(-1, 1, (128, 128)).astype(np.float32)


class Said(Finder):
    """A finder with a fixed result."""

    def __init__(self, *hands: FoundHand) -> None:
        self.said = list(hands)

    def hands(
        self, depth: np.ndarray, camera: Camera, min_presence: float = MIN_PRESENCE, most: int = 4
    ) -> list[FoundHand]:
        """The fixed result for any image."""
        return self.said[:most]


def found_at(frame: np.ndarray, place: Sequence[float], presence: float = 0.9) -> FoundHand:
    """What a finder says of a hand at a place (3,) in mm in a frame of KINECT2; its mask is what is
    within 110 mm.
    """
    rows, columns = np.indices(frame.shape)
    points = KINECT2.unproject(np.stack([columns, rows, np.maximum(frame, 1)], axis=-1))
    near = np.linalg.norm(points - place, axis=-1) < 110
    return FoundHand(presence, np.array(place, float), near & (frame > 0))
