"""handpose/estimate/estimator.py and expected.py: regions of frames with a known hand"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handpose.body.sides import MIRROR, SideView
from handpose.estimate.candidates import SearchRegion
from handpose.estimate.estimator import HandEstimator
from handpose.estimate.hand import HandEstimate
from handpose.estimate.packaged import load_predictor
from handpose.estimate.predictor import Predictor
from handpose.fit.body import WorldPose
from handpose.fit.settings import SearchSettings
from handpose.frames.cameras import ICVL, Camera
from handpose.frames.crops import SIZE, unread
from handpose.sequences.acts import Act
from handpose.sequences.recordings import Script, SyntheticRecording
from tests.handpose.tracking.conftest import Take
from tests.support.views import frame_of

FAR_OFF = np.array([-900.0, 120, 700])  # px, px, mm: no part of its cube is in the image
ASIDE = Camera("aside", 240.0, 241.0, 130.0, 110.0, 320, 240)


@pytest.fixture(scope="module")
def estimator(predictor: Predictor) -> HandEstimator:
    """An estimator for ICVL's camera."""
    return predictor.estimator


@pytest.fixture
def frame(shown: Take) -> SideView:
    """A frame with a right hand."""
    return frame_of(shown.frames[20].depth, ICVL)


@pytest.fixture
def center(shown: Take) -> np.ndarray:
    """The hand's place, (3,) px, px, mm."""
    return shown.truth[20].hands[0].pose.center_uvd


def error(estimate: HandEstimate | None, shown: Take) -> float:
    """The mean error of all joints in mm."""
    assert estimate is not None
    return float(np.linalg.norm(estimate.xyz - shown.truth[20].hands[0].xyz, axis=1).mean())


def test_a_hand_is_seen(
    estimator: HandEstimator, frame: SideView, center: np.ndarray, shown: Take
) -> None:
    """A hand is estimated with a small error and a high confidence, by both plans."""
    for plan in (None, SearchSettings().accurate):
        (estimate,) = estimator.in_regions(frame, [SearchRegion(center, "right")], plan)
        assert estimate is not None and error(estimate, shown) < 15
        assert estimate.confidence > 0.7
        np.testing.assert_allclose(estimate.center_mm, ICVL.unproject(center))


def test_the_wrong_side_has_a_larger_expected_error_and_cost(
    estimator: HandEstimator, frame: SideView, center: np.ndarray
) -> None:
    right, left = estimator.in_regions(
        frame, [SearchRegion(center, side) for side in ("right", "left")]
    )
    assert right is not None and left is not None and right.error_mm < left.error_mm
    assert right.selection_cost < left.selection_cost


def test_estimates_of_several_regions_equal_those_of_single_ones(
    estimator: HandEstimator, frame: SideView, center: np.ndarray
) -> None:
    """They are in the order of the regions, and None out of sight."""
    (before,) = estimator.in_regions(frame, [SearchRegion(center, "right")])
    assert before is not None
    regions = [
        SearchRegion(FAR_OFF, "left"),
        SearchRegion(center, "right", before.body, 1.0),
        SearchRegion(center + (5, 0, 0), "left"),
        SearchRegion(center, "right"),
        SearchRegion(center, "right", before.body, None, False),
        SearchRegion(center, "right", before.body, 0.95, False),
        SearchRegion(center + (2, 0, 0), "right", before.body),
        SearchRegion(FAR_OFF, "right", before.body),
    ]
    together = estimator.in_regions(frame, regions)
    assert [estimate is None for estimate in together] == [True] + [False] * 6 + [True]
    for region, estimate in zip(regions[1:-1], together[1:-1]):
        (alone,) = estimator.in_regions(frame, [region])
        assert estimate is not None and alone is not None and estimate.hand == region.side
        np.testing.assert_allclose(estimate.xyz, alone.xyz, atol=3)
    assert estimator.in_regions(frame, []) == []
    assert estimator.in_regions(frame, regions[:1]) == [None]


def test_a_known_size(estimator: HandEstimator, frame: SideView, center: np.ndarray) -> None:
    """Each region can have its own known size."""
    sizes = [0.9, 1.1]
    regions = [SearchRegion(center, "right", size=size) for size in sizes]
    found = [estimate.size for estimate in estimator.in_regions(frame, regions) if estimate]
    assert found == pytest.approx(sizes, abs=5e-3)


def test_the_network_does_not_run_where_it_is_not_asked(
    estimator: HandEstimator,
    frame: SideView,
    center: np.ndarray,
    shown: Take,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """From a previous pose, also about another centre."""
    (first,) = estimator.in_regions(frame, [SearchRegion(center, "right")])
    assert first is not None
    monkeypatch.setattr("handpose.estimate.crop_fits.fit_starts", None)  # any call raises an error
    near = SearchRegion(center, "right", first.body, asks_network=False)
    regions = [near, replace(near, center_uvd=center + (8, -6, 20))]
    estimates = estimator.in_regions(frame, regions)
    assert not first.is_tracked
    for estimate in estimates:
        assert error(estimate, shown) < 15 and estimate.is_tracked
    with pytest.raises(TypeError):
        estimator.in_regions(frame, [SearchRegion(center, "right", first.body)])


def test_is_tracked_only_if_the_previous_pose_wins_against_the_networks(
    estimator: HandEstimator, frame: SideView, center: np.ndarray
) -> None:
    (first,) = estimator.in_regions(frame, [SearchRegion(center, "right")])
    assert first is not None
    turned = first.body.rotation @ np.diag([-1.0, 1, -1])
    far = first.body._replace(others=-first.body.others, rotation=turned)
    regions = [SearchRegion(center, "right", body) for body in (first.body, far)]
    from_pose, from_network = estimator.in_regions(frame, regions)
    assert from_pose is not None and from_pose.is_tracked
    assert from_network is not None and not from_network.is_tracked


def test_a_left_hand_is_the_mirror_image() -> None:
    """A left hand in the mirrored image, with an off-centre principal point, is mirrored."""
    script = Script(3, {"right": (Act("gestures", 3),)})
    recording = SyntheticRecording(script, ASIDE, rate=15, seed=2)
    depth = recording.frame(20).depth
    center = recording.truth(20).hands[0].pose.center_uvd
    in_mirror = ASIDE.mirrored()
    right, left = (load_predictor(own, fit="accurate").estimator for own in (ASIDE, in_mirror))
    (one,) = right.in_regions(frame_of(depth, ASIDE), [SearchRegion(center, "right")])
    mirrored = frame_of(depth[:, ::-1], in_mirror)
    (other,) = left.in_regions(mirrored, [SearchRegion(center, "left")])
    assert one is not None and other is not None
    np.testing.assert_allclose(other.xyz * MIRROR, one.xyz, atol=1e-9)
    np.testing.assert_allclose(
        left.expected.center_of(other.body, ASIDE),
        right.expected.center_of(one.body, ASIDE),
        atol=1e-9,
    )


def test_the_next_crop_is_near_the_middle_of_the_palm(
    estimator: HandEstimator, frame: SideView, center: np.ndarray
) -> None:
    """By the fit and by the network."""
    (estimate,) = estimator.in_regions(frame, [SearchRegion(center + (10, 0, 0), "right")])
    assert estimate is not None
    for found in (
        estimator.expected.center_of(estimate.body, ICVL),
        estimator.palm_at(frame, center + (10, 0, 0)),
    ):
        assert np.linalg.norm(ICVL.unproject(found) - ICVL.unproject(center)) < 25
    outside = np.array([-900.0, 0, 600])
    assert estimator.palm_at(frame, outside) is outside


@given(place=st.tuples(st.floats(-200, 200), st.floats(-150, 150), st.floats(400, 900)))
def test_crops_move_with_the_body(estimator: HandEstimator, place: tuple[float, ...]) -> None:
    """The centre moves as far as the body."""
    others = np.zeros(len(estimator.the_fitter.model.root_motion.others))
    body = WorldPose(np.array(place), np.eye(3), others)
    moved = body._replace(place=body.place + (10, 20, -30))
    first, second = (
        ICVL.unproject(estimator.expected.center_of(one, ICVL)) for one in (body, moved)
    )
    np.testing.assert_allclose(second - first, (10, 20, -30), atol=1e-6)


def test_the_network_sees_no_covering(
    estimator: HandEstimator, frame: SideView, center: np.ndarray, shown: Take
) -> None:
    """What is in front of the cube hides the hand for the fit; for the network it is background."""
    (whole,) = estimator.in_regions(frame, [SearchRegion(center, "right")])
    assert whole is not None
    half, gone = np.array(frame.depth), np.array(frame.depth)
    half[: int(center[1])] = 100
    gone[: int(center[1])] = 2200
    region = SearchRegion(center, "right", whole.body)
    (behind,) = estimator.in_regions(frame_of(ICVL.in_range(half), ICVL, half), [region])
    (among,) = estimator.in_regions(frame_of(gone, ICVL), [region])
    assert among is not None and behind is not None
    np.testing.assert_array_equal(among.network_mm, behind.network_mm)
    assert error(behind, shown) < error(among, shown)


def test_unread_pixels_around_the_hand_are_unknown(
    estimator: HandEstimator, frame: SideView, center: np.ndarray
) -> None:
    """Without readings in more than one half, the crop is unknown up to ``around_mm`` from the
    expected hand, and empty beyond.
    """
    (whole,) = estimator.in_regions(frame, [SearchRegion(center, "right")])
    assert whole is not None
    around_mm = estimator.settings.expected.around_mm
    half = np.array(frame.depth)
    half[:, : int(center[0]) + 15] = 0
    region = SearchRegion(center, "right", whole.body)
    candidate = estimator._in_region(frame_of(half, ICVL), region)
    assert candidate.shown is not None
    hand = estimator.expected.capsules(whole.body).chosen(~estimator.the_fitter.model.surface.limbs)
    beside = (estimator.expected._rendered(hand, center, ICVL) == 1).astype(np.uint8)
    away_mm = cv2.distanceTransform(beside, cv2.DIST_L2, 5) * estimator.cube_mm / SIZE
    is_unknown = candidate.crop != candidate.shown
    is_unread = unread(half, center, estimator.cube_mm, ICVL)
    assert (candidate.crop[is_unknown] == -1).all() and (is_unread | ~is_unknown).all()
    assert is_unknown[is_unread & (away_mm < 0.7 * around_mm)].all()
    beyond = away_mm > 1.3 * around_mm
    assert not is_unknown[beyond].any() and is_unread[beyond].any()
