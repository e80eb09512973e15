"""handpose/estimate/estimator.py, through a predictor, for crops and for places in frames."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import netlib
from handpose.body.joint_formats.frames import palm_frame
from handpose.body.nyu import CENTER_IN_PALM, CUBE_MM
from handpose.body.sides import Side, mirror_of
from handpose.estimate.packaged import load_predictor
from handpose.estimate.palm import recenter
from handpose.estimate.predictor import PALM_MM, Predictor, depth_around
from handpose.fit.settings import CropSettings, Fit
from handpose.frames.cameras import KINECT2, NYU, Camera
from handpose.frames.crops import clear_crop, crop_pixels
from handpose.synthetic.pose_prior import BodySampler
from layers.hand.bodies import kinematics_of
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import SkeletonParameter
from netlib.errors import DataError, NetlibError
from netlib.proto import prototxt, schema
from tests.handpose.estimate.conftest import some_crop
from tests.support.bad_input import bad_inputs
from tests.support.packaged_hand import EXACT, SKELETON
from tests.support.views import frame_of

HAND = SKELETON
CENTRED = EXACT.but(center_jitter=0, center_jitter_wide=0)  # all centres at one place of a palm


def test_a_hand_behind_the_camera(fixed: Callable[..., netlib.Net], frame: np.ndarray) -> None:
    """A predicted joint behind the camera raises an error."""
    with pytest.raises(
        DataError,
        match=r"a pose is predicted in which a joint is at a depth of -\d+ mm, behind the camera",
    ):
        Predictor(fixed(0, 0, -140), KINECT2, refine=0).in_frame(frame, (260, 210, 160))


def test_a_crop_that_does_not_move_is_evaluated_once(
    seeing: netlib.Net, frame: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For any limit on the moves."""
    looks: list[int] = []
    monkeypatch.setattr(
        "handpose.estimate.estimator.recenter",
        lambda joints, skeleton, center, *rest: looks.append(1) or center.copy(),
    )
    found = Predictor(seeing, KINECT2, refine=100).in_frame(frame, (260, 210, 690))
    assert len(looks) == 1 and found.center_uvd.tolist() == [260, 210, 690]


@pytest.mark.parametrize("hand", ["right", "left"])
@pytest.mark.parametrize("refine", [0, 1, 2, 3])
def test_the_crop_goes_to_the_palm(
    fixed: Callable[..., netlib.Net], frame: np.ndarray, refine: int, hand: Side
) -> None:
    """Each refinement moves the crop by the hand's offset, and the result has the last crop."""
    beside = np.array([10.0, -5.0, 4.0]) * mirror_of(hand)
    predictor = Predictor(fixed(10, -5, 4), KINECT2, refine=refine, hand=hand)
    start = np.array([260.0, 210.0, 690.0])
    found = predictor.in_frame(frame, start)
    assert_allclose(found.center_mm, KINECT2.unproject(start) + refine * beside, atol=1e-3)
    view = frame_of(frame, KINECT2).of(hand)
    cut = clear_crop(view.depth, found.view_uvd, CUBE_MM, view.camera)
    assert_array_equal(found.view_crop, cut)


def test_a_crop_as_in_training_stays(fixed: Callable[..., netlib.Net], frame: np.ndarray) -> None:
    """A crop whose centre is at its place in the palm does not move."""
    found = Predictor(fixed(0, 0, 0), KINECT2).in_frame(frame, (260, 210, 690))
    assert_allclose(found.center_uvd, (260, 210, 690), atol=1e-3)
    palm = found.joints_mm[HAND.joint_names.index("palm")]
    assert np.linalg.norm(palm) == pytest.approx(np.linalg.norm(CENTER_IN_PALM), abs=1e-3)


def test_a_wrong_prediction_moves_the_crop_within_limits(
    fixed: Callable[..., netlib.Net], frame: np.ndarray
) -> None:
    """A wrong prediction moves the crop by at most ``max_move_mm``, not out of the image, and not
    to the camera.
    """
    start = np.array([260.0, 210.0, 690.0])
    found = Predictor(fixed(25, 0, 0), KINECT2, refine=9).in_frame(frame, start)
    moved = np.linalg.norm(found.center_mm - KINECT2.unproject(start))
    assert moved == pytest.approx(50, abs=1e-3) and moved < CropSettings().max_move_mm
    near = np.array([260.0, 210.0, 155.0])
    found = Predictor(fixed(0, 0, -20), KINECT2).in_frame(frame, near)
    assert_array_equal(found.center_uvd, near)
    corner = np.array([-40.0, 210.0, 690.0])
    found = Predictor(fixed(-50, 0, 0), KINECT2, cube_mm=200).in_frame(frame, corner)
    assert_array_equal(found.center_uvd, corner)


def test_a_hand_beside_the_start(frame: np.ndarray) -> None:
    """A start 25 mm off is near enough if the unmoved crop competes; a start outside the
    image is an error.
    """
    predictor = load_predictor(KINECT2, fit="fast", hand="right")
    for beside in ((0, 0, 0), (25, 0, 0)):
        start = KINECT2.project(np.array([30.0, -20, 700]) + beside)
        found = predictor.estimator.in_frame(frame_of(frame, KINECT2), start, is_middle=True)
        assert np.linalg.norm(found.center_mm - (30, -20, 700)) < 60
        assert found.fit is not None and found.camera == KINECT2
    with pytest.raises(DataError, match="lies outside the image"):
        outside = KINECT2.project(np.array([9000.0, 0, 700]))
        predictor.estimator.in_frame(frame_of(frame, KINECT2), outside)


def test_the_middle_of_the_joints_leads_to_the_crop_in_the_palm(frame: np.ndarray) -> None:
    """A finder gives this place; its crop is that of a centre that is given, up to a few mm."""
    predictor = load_predictor(KINECT2, fit="fast", hand="right")
    given = predictor.in_frame(frame, KINECT2.project(np.array([30.0, -20, 700])))
    middle = given.xyz[[not name.startswith("wrist") for name in predictor.skeleton.joint_names]]
    assert np.linalg.norm(middle.mean(axis=0) - given.center_mm) > 60
    place = KINECT2.project(middle.mean(axis=0))
    found = predictor.estimator.in_frame(frame_of(frame, KINECT2), place, is_middle=True)
    assert np.linalg.norm(found.center_mm - given.center_mm) < 25
    assert np.linalg.norm(found.xyz - given.xyz, axis=1).mean() < 5


def test_the_other_hand(seeing: netlib.Net) -> None:
    """A left hand is the mirror image of the prediction for the mirrored crop."""
    left = Predictor(seeing, hand="left").in_crop(some_crop())
    right = Predictor(seeing).in_crop(some_crop()[:, ::-1])
    assert_array_equal(left.joints, right.joints * (-1, 1, 1))
    assert_array_equal(left.crop, some_crop())


@pytest.mark.parametrize("hand", ["right", "left"])
def test_either_hand_is_where_it_is_seen(
    seeing: netlib.Net, monkeypatch: pytest.MonkeyPatch, hand: Side
) -> None:
    """A net that finds a small thing where training crops show it puts it at its place in space,
    for both sides.

    A pixel of the crop is 2.3 mm.
    """
    place, depth = np.array([40.0, 30.0, 700.0]), np.full((424, 512), 2000.0, np.float32)
    u, v, _ = KINECT2.project(place)
    depth[round(v) - 1 : round(v) + 2, round(u) - 1 : round(u) + 2] = 700

    def nearest(net: netlib.Net, crop: np.ndarray) -> np.ndarray:
        rows, columns = np.nonzero(crop < 1)
        at = crop_pixels(
            np.array([[[256.0, 212.0, 700.0]]]), [[256.0, 212.0, 700.0]], CUBE_MM, KINECT2
        )[0, 0]
        xyz = (columns.mean() - at[0]) / 64, (at[1] - rows.mean()) / 64, 0
        return np.tile(xyz, (len(HAND.joint_names), 1))

    monkeypatch.setattr("handpose.estimate.estimator.network_joints", nearest)
    found = Predictor(seeing, KINECT2, hand=hand, refine=0).in_frame(depth, (256.0, 212.0, 700.0))
    assert_allclose(found.xyz[0], place, atol=2.4)


def test_weights_that_are_not_finite_raise_an_error(fixed: Callable[..., netlib.Net]) -> None:
    net = fixed(0, 0, 0)
    net.params["DoF"][1].data[4] = np.nan
    with pytest.raises(NetlibError, match="predicts joints that are not finite; check its weights"):
        Predictor(net).in_crop(some_crop())


@pytest.mark.parametrize("fit", ["fast", "accurate"])
def test_a_left_hand_is_the_mirror_image_of_a_right_one(frame: np.ndarray, fit: Fit) -> None:
    """In the mirrored image, also with an off-centre principal point."""
    camera = Camera("part", KINECT2.fx, KINECT2.fy, KINECT2.u0 - 150, KINECT2.v0, 250, 424)
    part, place = frame[:, 150:400], np.array([30.0, -20, 700])
    center = camera.project(place)
    right = load_predictor(camera, fit=fit, hand="right").in_frame(part, center)
    in_mirror = load_predictor(camera.mirrored(), fit=fit, hand="left")
    left = in_mirror.in_frame(part[:, ::-1], (249 - center[0], *center[1:]))
    assert_allclose(left.xyz, right.xyz * (-1, 1, 1), atol=1e-9)
    assert (left.error_mm, left.confidence) == pytest.approx((right.error_mm, right.confidence))


# --------------------------------------------------------------------------------- crops and places


def stick(joints: str) -> Callable[[], object]:
    """A function that moves a crop for a skeleton of these joints."""
    body = Skeleton(
        schema.read(prototxt.parse(f'name: "stick" {joints}'), SkeletonParameter, "test")
    )
    return lambda: recenter(np.zeros((2, 3)), body, (320, 240, 700), CUBE_MM, NYU)


@bad_inputs(
    DataError,
    {
        "no depth around": (
            lambda: depth_around(np.zeros((80, 100)), 30, 50),
            "no depth around pixel 30, 50",
        ),
        **{
            f"pixel {u}, {v}": (
                lambda u=u, v=v: depth_around(np.zeros((80, 100)), u, v),
                f"pixel {u}, {v} lies outside the image of 100 x 80",
            )
            for u, v in ((-1, 50), (99.6, 50), (50, 80))
        },
        "no palm": (
            stick('joint { name: "a" }'),
            "skeleton 'stick' has no joint 'palm' to move the crop to",
        ),
        "one bone": (
            stick(
                'joint { name: "palm" } joint { name: "a" parent: "palm" bone { axis: X length: 1 } }'
            ),
            "skeleton 'stick' has too few joints fixed to the palm to tell how it is turned",
        ),
    },
)
def test_places_without_depth_and_bodies_without_a_palm_are_rejected(given, rejected):
    with rejected:
        given()


@pytest.fixture(scope="module")
def hands():
    """Inputs (N, 47) of hands as in training crops, their crop centres (N, 3) in mm,
    and the sampler.
    """
    sampler, rng = BodySampler(prior=CENTRED), np.random.default_rng(7)
    return sampler.draw(rng, 16).inputs, NYU.unproject(sampler.centers(rng, 16, NYU)), sampler


def moved(inputs, sampler, by):
    """The joints (N, 31, 3) of the same hands, moved by ``by`` mm relative to the crop centre."""
    result = inputs.copy()
    for axis, distance in zip("xyz", by):
        result[:, sampler.skeleton.dof_names.index(f"palm_{axis}")] += distance / (CUBE_MM / 2)
    return kinematics_of(sampler.skeleton).joints(result)


def test_recentering_removes_the_error_of_the_center(hands):
    inputs, centers, sampler = hands
    off = np.array([25.0, -40.0, 30.0])
    for joints, center in zip(moved(inputs, sampler, off), centers):
        found = recenter(joints, sampler.skeleton, NYU.project(center - off), CUBE_MM, NYU)
        assert NYU.unproject(found) == pytest.approx(center, abs=1e-9)


def test_the_rotation_of_the_palm_is_computed_from_joints(hands, rng):
    """With noise it is a rotation close to the true one."""
    inputs, _, sampler = hands
    kinematics = kinematics_of(sampler.skeleton)
    pose = kinematics.forward(inputs)
    truth = kinematics.rotation_of(pose, sampler.skeleton.joint_names.index("palm"))
    for joints, frame in zip(pose.joints, truth):
        assert_allclose(palm_frame(joints, sampler.skeleton), frame, atol=1e-12)
        near = palm_frame(joints + rng.normal(0, 0.01, joints.shape), sampler.skeleton)
        assert_allclose(near.T @ near, np.eye(3), atol=1e-12)
        assert np.linalg.det(near) == pytest.approx(1)
        assert np.abs(near - frame).max() < 0.15


def test_the_median_depth_around_a_pixel():
    """The result is the median of readings within 8 pixels, plus half the thickness of a palm."""
    image = np.zeros((100, 100))
    image[40:61, 40:61] = 700
    image[50, 50:53] = (np.nan, np.inf, 200)
    assert depth_around(image, 50.4, 49.6) == pytest.approx([50.4, 49.6, 700 + PALM_MM])
    assert depth_around(image, 33, 50)[2] == 700 + PALM_MM, "8 pixels away"


def test_a_pixel_in_the_corner():
    """At the image border the neighbourhood is clipped."""
    image = np.full((100, 100), 900.0)
    image[:5, :5] = 0
    assert depth_around(image, 0, 0)[2] == depth_around(image, 99, 99)[2] == 900 + PALM_MM
