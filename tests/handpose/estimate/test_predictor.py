"""handpose/estimate/predictor.py: the Python interface, for crops and whole frames."""

from __future__ import annotations

from typing import Any
from unittest import mock

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import netlib
from handpose.estimate.nets import best_fit, skeleton_to_fit
from handpose.estimate.packaged import load_predictor
from handpose.estimate.predictor import Predictor, depth_around
from handpose.frames.cameras import KINECT2, NYU, VIEWS, Camera
from handpose.frames.images import UnitError
from netlib.errors import DataError, NetlibError
from tests.handpose.estimate.conftest import NET, NetOf, Said, found_at, some_crop
from tests.support.bad_input import bad_inputs

# -------------------------------------------------------------------------------------------- crops


@pytest.mark.parametrize(("batch", "cube"), [(1, 300.0), (5, 261.0)])
def test_a_crop(net_of: NetOf, batch: int, cube: float) -> None:
    """The joints are those of the net's forward pass, in half-cubes and in mm of the cube; crops
    may be float64.
    """
    net = net_of(NET % batch, netlib.TEST)
    found = Predictor(net, cube_mm=cube).in_crop(some_crop().astype(np.float64))
    expected = net.forward(depth=some_crop()[None, None])["pred"].reshape(31, 3)
    assert_array_equal(found.joints, expected)
    assert_allclose(found.joints_mm, expected * cube / 2)
    assert_array_equal(found.crop, some_crop())
    assert found.joints.dtype == np.float64
    assert not np.array_equal(Predictor(net).in_crop(-some_crop()).joints, found.joints)


EXPECTED = "expected a net with the input depth and the output pred"


@bad_inputs(
    NetlibError,
    {
        "depth": (NET.replace('"depth"', '"crop"'), f"<net>: no blob 'depth'; {EXPECTED}"),
        "pred": (NET.replace('"pred"', '"joints"'), f"<net>: no blob 'pred'; {EXPECTED}"),
        "hand": (
            NET[: NET.index('layer { name: "hand"')].replace('top: "DoF"', 'top: "pred"'),
            "<net>: no HandModel layer, so the skeleton is unknown",
        ),
    },
)
def test_nets_of_another_kind(net_of: NetOf, given: str, rejected: Any) -> None:
    """A net with other blobs or layers raises an error at construction."""
    with rejected:
        Predictor(net_of(given % 1, netlib.TEST))


@bad_inputs(
    DataError,
    {
        "shape": (some_crop()[None], "crop of shape (1, 128, 128), expected (128, 128)"),
        "bytes": (
            np.arange(128 * 128).reshape(128, 128) % 256,
            "crop with values from 0 to 255, expected -1 to 1",
        ),
        "nan": (
            np.full((128, 128), np.nan),
            "crop with values that are not numbers, expected -1 to 1",
        ),
        "infinite": (
            np.full((128, 128), -np.inf),
            "crop with values from -inf to -inf, expected -1 to 1",
        ),
        "list": ([[0.0]], "crop is a list, expected an array of numbers"),
        "text": (np.full((128, 128), "a"), "crop is an array of <U1, expected numbers"),
    },
)
def test_invalid_crops_are_rejected(seeing: netlib.Net, given: Any, rejected: Any) -> None:
    """A crop of another shape or with invalid values raises an error about the crop, not about the
    net.
    """
    with rejected:
        Predictor(seeing).in_crop(given)


def test_a_net_that_predicts_bones(net_of: NetOf) -> None:
    """A fit does not support predicted bones, which raises an error."""
    bones = 'layer { name: "b" type: "InnerProduct" bottom: "depth" top: "b" inner_product_param { num_output: 31 } }'
    net = net_of(
        NET.replace('bottom: "DoF" top: "pred"', 'bottom: "DoF" bottom: "b" top: "pred"').replace(
            'layer { name: "hand"', bones + 'layer { name: "hand"'
        )
        % 1,
        netlib.TEST,
    )
    for refused in (
        lambda: Predictor(net, fit="fast").in_crop(some_crop()),
        lambda: skeleton_to_fit(net),
    ):
        with pytest.raises(
            NetlibError, match="layer 'hand' takes the bones of each hand from blob 'b'"
        ):
            refused()
    assert best_fit(net) == "no"


def test_masked_pixels_are_background_in_crops_and_unread_in_frames(
    seeing: netlib.Net, frame: np.ndarray
) -> None:
    shown, predictor = some_crop(), Predictor(seeing, KINECT2, refine=0)
    shown[:20] = 1
    hidden = np.ma.array(some_crop(), mask=np.arange(128)[:, None] < np.full(128, 20))
    assert_array_equal(predictor.in_crop(hidden).joints, predictor.in_crop(shown).joints)
    holes, predictor = (
        np.where(frame > 1000, 0, frame),
        load_predictor(KINECT2, fit="fast", hand="right"),
    )
    for center in (None, (270, 215)):
        found, same = (
            predictor.in_frame(depth, center) for depth in (np.ma.masked_equal(holes, 0), holes)
        )
        assert_array_equal(found.xyz, same.xyz)


# ------------------------------------------------------------------------------------------- frames


def test_a_hand_below_the_minimum_confidence(frame: np.ndarray) -> None:
    """It has its place, side, confidence and expected error, but nothing of a pose, in a frame
    and in a crop.
    """
    predictor = load_predictor(KINECT2, fit="fast", hand="right", min_confidence=0)
    crop = predictor.in_frame(frame).crop
    for predict, image, in_frame in (
        (predictor.in_frame, frame, True),
        (predictor.in_crop, crop, False),
    ):
        predictor.min_confidence = 0
        whole = predict(image)
        predictor.min_confidence = whole.confidence
        assert whole.has_joints and predict(image).has_joints and whole.in_frame == in_frame
        predictor.min_confidence = np.nextafter(whole.confidence, 1)
        found = predict(image)
        assert not found.has_joints and np.isnan([found.size, *found.xyz.ravel()]).all()
        for name in ("hand", "confidence", "error_mm", "in_frame", "center_uvd"):
            assert_array_equal(getattr(found, name), getattr(whole, name))
        with pytest.raises(AssertionError, match="a hand without a fit"):
            found.inputs  # noqa: B018


def test_a_confidence_that_was_not_measured_is_not_below(seeing: netlib.Net) -> None:
    """The network alone has none."""
    found = Predictor(seeing, min_confidence=1).in_crop(some_crop())
    assert np.isnan(found.confidence) and found.has_joints


@bad_inputs(
    DataError,
    {
        **{
            f"center {center}": (
                (lambda frame: frame, KINECT2, center),
                f"center {center}, expected two or three finite "
                "numbers: u, v in px or u, v, d in px, px, mm",
            )
            for center in (
                (np.nan, 200),
                (300,),
                (1, 2, 3, 4),
                (1, 2, np.inf),
                "palm",
                ((1, 2), (3, 4)),
            )
        },
        **{
            f"metres, {center}": (
                (lambda frame: frame * 0.001, KINECT2, center),
                UnitError,
                "depths from 0.583 to 1.5, ...",
            )
            for center in (None, (260, 210, 700))
        },
        "nothing": ((np.zeros_like, KINECT2, (260, 210)), "no depth around pixel 260, 210"),
        "another camera": (
            (lambda frame: frame, NYU, (260, 210)),
            "depth image: 512 x 424 pixels; camera nyu has 640 x 480",
        ),
        "channels": (
            (lambda frame: frame[:, :, None], KINECT2, None),
            "depth image of shape (424, 512, 1), expected (height, width)",
        ),
    },
)
def test_invalid_frames_and_centers_are_rejected(
    seeing: netlib.Net, frame: np.ndarray, given: Any, rejected: Any
) -> None:
    """A frame in another unit, of another size or without readings, and an invalid centre,
    raise an error.
    """
    change, camera, center = given
    with rejected:
        Predictor(seeing, camera).in_frame(change(frame), center)


def test_a_finder_is_loaded_when_it_is_used(seeing: netlib.Net, frame: np.ndarray) -> None:
    """The finder is loaded once, by the first frame without a centre."""
    load = mock.Mock(return_value=Said(found_at(frame, (30.0, -20, 700))))
    predictor = Predictor(seeing, KINECT2, refine=0, finder=load)
    predictor.in_crop(some_crop())
    predictor.in_frame(frame, (260, 210, 690))
    load.assert_not_called()
    for _ in range(2):
        assert_allclose(predictor.in_frame(frame).center_mm, (30, -20, 700))
    load.assert_called_once_with()
    assert predictor.finder is load.return_value


def test_the_start_is_a_pixel_or_a_place(seeing: netlib.Net, frame: np.ndarray) -> None:
    """A pixel is completed by the depth around it."""
    predictor = Predictor(seeing, KINECT2, refine=0)
    assert_array_equal(
        predictor.in_frame(frame, (260, 210)).center_uvd, depth_around(frame, 260, 210)
    )
    assert_array_equal(predictor.in_frame(frame, (260, 210, 700)).center_uvd, [260, 210, 700])


@pytest.mark.parametrize(
    ("finder", "said"), [(None, "this predictor has no finder"), (Said(), "no hand is seen")]
)
def test_without_a_found_hand_a_place_is_required(
    seeing: netlib.Net, frame: np.ndarray, finder: Said | None, said: str
) -> None:
    predictor = Predictor(seeing, KINECT2, refine=0, finder=finder)
    with pytest.raises(DataError, match=rf"^{said}.* give .* place \(center\)$"):
        predictor.in_frame(frame)


def test_frames_of_other_sizes(seeing: netlib.Net, frame: np.ndarray) -> None:
    """A camera without a size accepts any frame."""
    own = Camera("own", KINECT2.fx, KINECT2.fy, KINECT2.u0, KINECT2.v0, 0, 0)
    found, same = (
        Predictor(seeing, camera).in_frame(frame, (260, 210)) for camera in (own, KINECT2)
    )
    assert_array_equal(found.joints, same.joints)
    assert (found.camera.width, found.camera.height) == (512, 424)


# ------------------------------------------------------------------------------------------- places


def test_the_hand_with_the_highest_presence(seeing: netlib.Net, frame: np.ndarray) -> None:
    """Without a fit it is the start; a given place is not looked for."""
    said = Said(found_at(frame, (30.0, -20, 700)), found_at(frame, (0, 0, 900), 0.5))
    predictor = Predictor(seeing, KINECT2, refine=0, finder=said)
    found = predictor.in_frame(frame)
    assert_allclose(found.center_mm, said.said[0].middle)
    assert found.presence == 0.9
    given = predictor.in_frame(frame, (260, 210, 690))
    assert given.center_uvd.tolist() == [260, 210, 690] and np.isnan(given.presence)


def test_the_found_hand_with_a_sure_pose_is_selected(frame: np.ndarray) -> None:
    """Also if another place is more likely a hand."""
    predictor = load_predictor(KINECT2, fit="fast", hand="right")
    hand, wall = found_at(frame, (30.0, -20, 700), 0.5), found_at(frame, (-250.0, 100, 1480), 0.7)
    predictor.finder = Said(wall, hand)
    found = predictor.in_frame(frame)
    assert np.linalg.norm(found.center_mm - hand.middle) < 60 and found.presence == 0.5


# ------------------------------------------------------------------------------------------ options


WHOLE = "expected a whole number from 0 to 100"


@bad_inputs(
    NetlibError,
    {
        line: (option, line)
        for option, line in (
            ({"hand": "Left"}, "hand='Left' (did you mean 'left'?); expected right, left, either"),
            ({"hand": None}, "hand=None; expected right, left, either"),
            ({"fit": "best"}, "fit='best'; expected no, fast, accurate"),
            ({"refine": -1}, f"refine=-1; {WHOLE}"),
            ({"refine": 1.5}, f"refine=1.5; {WHOLE}"),
            ({"refine": 10**9}, f"refine=1000000000; {WHOLE}"),
            ({"cube_mm": 0.3}, "cube_mm=0.3; expected 50 to 10000 mm"),
            ({"cube_mm": np.nan}, "cube_mm=nan; expected 50 to 10000 mm"),
            ({"cube_mm": "300"}, "cube_mm='300'; expected 50 to 10000 mm"),
            ({"camera": "nyu"}, "camera is a str; expected a Camera, such as handpose.NYU"),
            ({"camera": VIEWS["d435"]}, "camera is a View; ..."),
            ({"min_confidence": 30}, "min_confidence=30; expected a number from 0 to 1"),
            ({"min_confidence": np.nan}, "min_confidence=nan; expected a number from 0 to 1"),
        )
    },
)
def test_invalid_options_are_rejected(
    seeing: netlib.Net, given: dict[str, Any], rejected: Any
) -> None:
    """The error is raised at construction, also with the packaged weights."""
    for make in (lambda: Predictor(seeing, **given), lambda: load_predictor(**given)):
        with rejected:
            make()
