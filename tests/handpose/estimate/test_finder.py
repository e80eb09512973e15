"""handpose/estimate/finder.py"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handpose.estimate.finder import VOTE_MM, Finder, FoundHand, channels_of
from handpose.estimate.packaged import load_finder
from handpose.fit.settings import FinderSettings
from handpose.frames.cameras import Camera
from netlib.errors import DataError, NetlibError

CAMERA = Camera("made", 160.0, 160.0, 80.0, 64.0, 160, 128)
PALMS = {"right": np.array([-120.0, 30.0, 520.0]), "left": np.array([130.0, -40.0, 620.0])}
RADIUS_MM, BEHIND_MM = 60.0, 1000.0


def frame() -> np.ndarray:
    """Two discs, 20 mm before their palms, in front of a wall."""
    depth = np.full((128, 160), BEHIND_MM, np.float32)
    for palm in PALMS.values():
        u, v, _ = CAMERA.project(palm - (0, 0, 20))
        row, column = np.indices(depth.shape)
        depth[np.hypot(column - u, row - v) < RADIUS_MM * CAMERA.fx / palm[2]] = palm[2] - 20
    return depth


class TrueNet:
    """Answers as a perfect net for ``frame``, whatever it is shown."""

    source = "made.prototxt"

    def __init__(self, **changed: np.ndarray) -> None:
        depth = frame()
        row, column = np.indices(depth.shape)
        points = CAMERA.unproject(np.stack([column, row, depth], axis=-1))
        hand = depth < BEHIND_MM
        owner = np.where(depth == PALMS["right"][2] - 20, 0, 1)
        palms = np.stack([*PALMS.values()])
        presence = np.full((32, 40), 0.01, np.float32)
        for palm, chance in zip(palms, (0.9, 0.6)):
            u, v, _ = np.rint(CAMERA.project(palm) / 4).astype(int)
            presence[v, u] = chance
            presence[v, u + 3] = chance - 0.2  # whose votes mean the same palm
        votes = np.where(hand[..., None], palms[owner] - points, 0) / VOTE_MM
        one = np.stack([~hand, hand, 0 * hand])[:, ::2, ::2]
        self.answers = {
            "class": one,
            "presence": presence[None],
            "votes": np.moveaxis(votes[::4, ::4], -1, 0),
        }
        self.answers = {
            name: values[None].astype(np.float32)
            for name, values in (self.answers | changed).items()
        }
        self.blobs: dict[str, Any] = {"frame": np.zeros((1, 4, 128, 160)), **self.answers}

    def forward(self, blobs: list[str], frame: np.ndarray) -> dict[str, np.ndarray]:
        return self.answers


def found_in(
    depth: np.ndarray, camera: Camera = CAMERA, most: int = 4, **changed: np.ndarray
) -> list[FoundHand]:
    return Finder(TrueNet(**changed)).hands(depth, camera, most=most)  # type: ignore[arg-type]


def test_palms_and_masks_of_two_hands() -> None:
    first, second = found_in(frame())
    for hand, side in ((first, "right"), (second, "left")):
        assert_allclose(hand.middle, PALMS[side], atol=0.3)
        true = frame() == PALMS[side][2] - 20
        assert not (hand.mask & ~true).any()
        assert hand.mask.sum() > 0.9 * true.sum()
        assert hand.weight is not None and hand.weight[true].mean() > 0.9
        other = ~true & (frame() < BEHIND_MM)
        for pixels in (other, ~true):
            assert hand.weight[pixels].mean() == pytest.approx(FinderSettings().doubt, abs=0.02)
    assert (first.presence, second.presence) == pytest.approx((0.9, 0.6), abs=1e-3)
    assert [hand.presence for hand in found_in(frame(), most=1)] == [first.presence]


def test_a_finer_camera_gives_the_same_hands_and_masks_of_its_own_size() -> None:
    fine = Camera("fine", 480.0, 480.0, 240.0, 192.0, 480, 384)
    coarse, again = found_in(frame()), found_in(np.kron(frame(), np.ones((3, 3), np.float32)), fine)
    for one, other in zip(coarse, again, strict=True):
        assert_allclose(one.middle, other.middle, atol=0.3)
        assert other.mask.shape == (384, 480)
        assert other.mask[::3, ::3].sum() == pytest.approx(one.mask.sum(), rel=0.1)


def test_the_packaged_net_sees_frames_padded_to_its_stride() -> None:
    """Of any size; any place with a reading may be a hand."""
    finder = load_finder()
    camera = replace(CAMERA, fx=320.0, fy=300.0, width=150, height=100)
    found = finder.hands(np.full((100, 150), 600, np.uint16), camera, min_presence=0.0)
    assert (
        finder.net.blobs["frame"].shape == (1, 4, 64, 96)
        and finder.net.blobs["frame"].data[0, 0].sum() == 53 * 75
    )
    assert found and all(hand.mask.shape == (100, 150) for hand in found)


def test_no_hand_is_found_without_depth() -> None:
    depth = frame()
    depth[:, :80] = 0
    assert [hand.presence for hand in found_in(depth)] == pytest.approx([0.6], abs=1e-3)
    assert found_in(np.zeros_like(depth)) == []


def test_readings_nearer_than_the_camera_measures_do_not_count() -> None:
    assert found_in(frame(), replace(CAMERA, min_range_mm=2000.0)) == []


def test_channels_of_a_plane() -> None:
    depth = np.full((1, 8, 8), 600.0, np.float32)
    depth[0, 0, 0] = 0
    channels = channels_of(depth)
    assert channels[0, 0].sum() == 63 and not channels[0, 1:].any()


def test_channels_of_a_slope() -> None:
    """A surface at 45 degrees across has a slope of sin 45 degrees and none down."""
    u = np.arange(9) - 4
    depth = np.tile(600 / (1 - u / 160), (9, 1)).astype(np.float32)[None]  # z = 600 + x
    channels = channels_of(depth)
    assert_allclose(channels[0, 2, :, 1:-1], np.sin(np.pi / 4), atol=0.02)
    assert not channels[0, 3].any()


def test_the_net_sees_angles_whatever_the_camera() -> None:
    """A surface at 45 degrees across to the rays, by a camera with twice as many columns as
    rows an angle.
    """
    camera = Camera(
        "wide", 2 * CAMERA.fx, CAMERA.fy, 2 * CAMERA.u0, CAMERA.v0, 2 * CAMERA.width, CAMERA.height
    )
    across = 700 * np.exp((np.arange(camera.width) - camera.u0) / camera.fx)
    net, shown = TrueNet(), []
    net.forward = lambda blobs, frame: shown.append(frame) or net.answers  # type: ignore[method-assign]
    Finder(net).hands(np.tile(across, (camera.height, 1)), camera)  # type: ignore[arg-type]
    assert_allclose(shown[0][0, 2, :, 1:-1], np.sin(np.pi / 4), atol=0.02)
    assert not shown[0][0, 3].any()


def test_frames_and_answers_that_do_not_fit() -> None:
    with pytest.raises(DataError, match=r"\(100, 160\), expected \(128, 160\)"):
        found_in(frame()[:100])
    with pytest.raises(NetlibError, match="not finite"):
        found_in(frame(), presence=np.full((1, 32, 40), np.nan))
    with pytest.raises(
        NetlibError, match=r"blob 'votes' of shape \(2, 32, 40\) an item, expected \(3, 32, 40\)"
    ):
        found_in(frame(), votes=np.zeros((2, 32, 40)))
    net = TrueNet()
    del net.blobs["frame"]
    with pytest.raises(NetlibError, match="no blob 'frame'"):
        Finder(net)  # type: ignore[arg-type]
