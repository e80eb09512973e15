"""handpose/estimate/predictor.py: the Python interface, for crops and whole frames."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import netlib
from handpose.body.nyu import CUBE_MM
from handpose.estimate.nets import best_fit, skeleton_to_fit
from handpose.estimate.packaged import load_predictor
from handpose.estimate.predictor import Predictor, depth_around
from handpose.frames.cameras import KINECT2, NYU, Camera
from handpose.frames.crops import clear_crop
from handpose.frames.images import UnitError
from layers.hand import skeleton
from layers.hand.bodies import kinematics_of
from netlib.errors import DataError, NetlibError
from tests.handpose.estimate.conftest import NET, NetOf, Said, found_at, some_crop
from tests.support.bad_input import bad_inputs

HAND = skeleton.load()


# ------------------------------------------------------------------------------------------------- crops


def test_a_crop(fixed: Callable[..., netlib.Net]) -> None:
    """The joints are those of the hand model, in half-cubes and in mm of the cube; the crop is returned as well."""
    net = fixed(10, -20, 30)
    inputs = net.params["DoF"][1].data[None].astype(np.float64)
    for cube in (300.0, 261.0):
        found = Predictor(net, cube_mm=cube).in_crop(some_crop())
        np.testing.assert_allclose(found.joints, kinematics_of(HAND).joints(inputs)[0], atol=1e-6)
        np.testing.assert_allclose(found.joints_mm, found.joints * cube / 2)
        np.testing.assert_array_equal(found.crop, some_crop())
        assert found.joints.dtype == np.float64 and found.joints.shape == (31, 3)


@pytest.mark.parametrize("batch", [1, 5])
def test_as_the_net_says(net_of: NetOf, batch: int) -> None:
    """The joints equal those of the net's forward pass, for any batch size; crops may be float64."""
    net = net_of(NET % batch, netlib.TEST)
    found = Predictor(net).in_crop(some_crop().astype(np.float64))
    again = net.forward(depth=some_crop()[None, None])["pred"].reshape(31, 3)
    np.testing.assert_array_equal(found.joints, again)
    assert not np.array_equal(Predictor(net).in_crop(-some_crop()).joints, found.joints)


EXPECTED = "expected a net with the input depth and the output pred"


@bad_inputs(NetlibError, {
    "depth": (NET.replace('"depth"', '"crop"'), f"<net>: no blob 'depth'; {EXPECTED}"),
    "pred": (NET.replace('"pred"', '"joints"'), f"<net>: no blob 'pred'; {EXPECTED}"),
    "hand": (NET[: NET.index('layer { name: "hand"')].replace('top: "DoF"', 'top: "pred"'),
             "<net>: no HandModel layer, so the skeleton is unknown"),
})
def test_nets_of_another_kind(net_of: NetOf, given: str, rejected: Any) -> None:
    """A net with other blobs or layers raises an error at construction."""
    with rejected:
        Predictor(net_of(given % 1, netlib.TEST))


@bad_inputs(DataError, {
    "shape": (some_crop()[None], "crop of shape (1, 128, 128), expected (128, 128)"),
    "bytes": (np.arange(128 * 128).reshape(128, 128) % 256, "crop with values from 0 to 255, expected -1 to 1"),
    "nan": (np.full((128, 128), np.nan), "crop with values that are not numbers, expected -1 to 1"),
    "infinite": (np.full((128, 128), -np.inf), "crop with values from -inf to -inf, expected -1 to 1"),
    "list": ([[0.0]], "crop is a list, expected an array of numbers"),
    "text": (np.full((128, 128), "a"), "crop is an array of <U1, expected numbers"),
})
def test_crops_that_are_refused(seeing: netlib.Net, given: Any, rejected: Any) -> None:
    """A crop of another shape or with invalid values raises an error about the crop, not about the net."""
    with rejected:
        Predictor(seeing).in_crop(given)


SIZED = NET.replace('bottom: "DoF" top: "pred"', 'bottom: "DoF" bottom: "size" top: "pred"').replace(
    'layer { name: "hand"',
    """layer { name: "size" type: "InnerProduct" bottom: "depth" top: "size"
        inner_product_param { num_output: 1 bias_filler { type: "constant" value: 1.5 } } }
layer { name: "hand\"""",
)


def test_a_net_that_predicts_the_size(net_of: NetOf) -> None:
    """The joints are those of the net's hand model, in the predicted size."""
    net = net_of(SIZED % 1, netlib.TEST)
    bias = net.params["DoF"][1].data
    net.params["DoF"][0].data[...], bias[...] = 0, -HAND.initial * HAND.slides * 1.5  # the palm in the middle
    found = Predictor(net).in_crop(some_crop())
    usual = HAND.scaled(1.5)
    assert np.allclose(found.joints, kinematics_of(usual).joints(bias[None].astype(float))[0], atol=1e-5)
    assert best_fit(net) == "accurate"


def test_a_net_that_predicts_bones(net_of: NetOf) -> None:
    """A fit does not support predicted bones, which raises an error."""
    boned = SIZED.replace("num_output: 1 ", "num_output: 31 ") % 1
    net = net_of(boned, netlib.TEST)
    message = "layer 'hand' takes the bones of each hand from blob 'size', which a fit does not know; do without a fit"
    with pytest.raises(NetlibError, match=message):
        Predictor(net, fit="fast").in_crop(some_crop())
    with pytest.raises(NetlibError, match=message):
        skeleton_to_fit(net)
    assert best_fit(net) == "no"


def test_a_masked_crop(seeing: netlib.Net) -> None:
    """Masked pixels of a crop are background."""
    shown = some_crop()
    shown[:20] = 1
    hidden = np.ma.array(some_crop(), mask=np.arange(128)[:, None] < np.full(128, 20))
    predictor = Predictor(seeing)
    np.testing.assert_array_equal(predictor.in_crop(hidden).joints, predictor.in_crop(shown).joints)


# ------------------------------------------------------------------------------------------------ frames


def test_a_hand_below_the_minimum_confidence(frame: np.ndarray) -> None:
    """It has its place, side, confidence and expected error, but nothing of a pose, in a frame and in a crop."""
    predictor = load_predictor(KINECT2, fit="fast", hand="right", min_confidence=0)
    crop = predictor.in_frame(frame).crop
    for predict, image in ((predictor.in_frame, frame), (predictor.in_crop, crop)):
        predictor.min_confidence = 0
        whole = predict(image)
        predictor.min_confidence = whole.confidence
        assert whole.has_joints and predict(image).has_joints
        predictor.min_confidence = np.nextafter(whole.confidence, 1)
        found = predict(image)
        assert not found.has_joints and (found.hand, found.confidence, found.error_mm, found.in_frame) == (
            whole.hand, whole.confidence, whole.error_mm, whole.in_frame)
        np.testing.assert_array_equal(found.center_uvd, whole.center_uvd)
        assert all(np.isnan(values).all() for values in (found.xyz, found.joints, found.joints_mm, found.size))
        with pytest.raises(AssertionError, match="a hand without a fit"):
            found.inputs  # noqa: B018


def test_a_confidence_that_was_not_measured_is_not_below(seeing: netlib.Net) -> None:
    """The network alone has none."""
    found = Predictor(seeing, min_confidence=1).in_crop(some_crop())
    assert np.isnan(found.confidence) and found.has_joints


def test_a_masked_frame(seeing: netlib.Net, frame: np.ndarray) -> None:
    """Masked pixels of a frame have no reading."""
    holes = np.where(frame > 1000, 0, frame)
    predictor = load_predictor(KINECT2, fit="fast", hand="right")
    for center in (None, (270, 215)):
        found, same = (predictor.in_frame(depth, center) for depth in (np.ma.masked_equal(holes, 0), holes))
        np.testing.assert_array_equal(found.xyz, same.xyz)
    hidden = np.ma.array(frame, mask=frame > 1000)
    np.testing.assert_array_equal(
        clear_crop(hidden, (270, 215, 700), 300, KINECT2), clear_crop(holes, (270, 215, 700), 300, KINECT2)
    )


SHAPE = "depth image of shape {}, expected {}"


@bad_inputs(DataError, {
    **{f"center {center}": ((lambda frame: frame, KINECT2, center), f"center {center}, expected two or three finite "
                            "numbers: u, v in px or u, v, d in px, px, mm")
       for center in ((np.nan, 200), (300,), (1, 2, 3, 4), (1, 2, np.inf), "palm", ((1, 2), (3, 4)))},
    **{f"{unit}, {center}": ((lambda frame, factor=factor: frame * factor, KINECT2, center), UnitError, line)
       for center in (None, (260, 210, 700)) for unit, factor, line in (
           ("metres", 0.001, "depths from 0.579 to 1.5, expected mm; they may be metres"),
           ("micrometres", 1000, "depths from 579424 to 1.5e+06, expected mm, nearer than 20000; check the unit"),
           ("negative", -1, "depths from -1500 to -579.424, expected mm, growing away from the camera"))},
    "nothing": ((np.zeros_like, KINECT2, (260, 210)), "no depth around pixel 260, 210"),
    "another camera": ((lambda frame: frame, NYU, (260, 210)),
                       SHAPE.format("(424, 512)", "(480, 640) of camera 'nyu'")),
    "channels": ((lambda frame: frame[:, :, None], KINECT2, None), SHAPE.format("(424, 512, 1)", "(height, width)")),
})
def test_frames_that_are_refused(seeing: netlib.Net, frame: np.ndarray, given: Any, rejected: Any) -> None:
    """A frame in another unit, of another size or without readings, and an invalid centre, raise an error."""
    change, camera, center = given
    with rejected:
        Predictor(seeing, camera).in_frame(change(frame), center)


def test_frames_of_other_sizes_with_a_finder(frame: np.ndarray) -> None:
    with pytest.raises(DataError, match="depth image of 512 x 424 px, expected 640 x 480 px of the camera nyu"):
        load_predictor(NYU).in_frame(frame)


def test_a_frame_with_its_centre(seeing: netlib.Net, frame: np.ndarray) -> None:
    """Without refinement the joints are those of the crop at this centre, also relative to the camera."""
    center = [260.0, 210.0, 690.0]
    found = Predictor(seeing, KINECT2, refine=0).in_frame(frame, center)
    np.testing.assert_array_equal(found.crop, clear_crop(frame, center, CUBE_MM, KINECT2))
    np.testing.assert_array_equal(found.joints, Predictor(seeing).in_crop(found.crop).joints)
    np.testing.assert_array_equal(found.center_uvd, center)
    np.testing.assert_allclose(found.center_mm, KINECT2.unproject(center))
    np.testing.assert_allclose(found.xyz, KINECT2.unproject(center) + found.joints * 150)
    assert found.camera == KINECT2


def test_a_finder_is_loaded_when_it_is_used(seeing: netlib.Net, frame: np.ndarray) -> None:
    """The finder is loaded once, by the first frame without a centre."""
    loads: list[Said] = []

    def load() -> Said:
        loads.append(Said(found_at(frame, (30.0, -20, 700))))
        return loads[-1]

    predictor = Predictor(seeing, KINECT2, refine=0, finder=load)
    predictor.in_crop(some_crop())
    predictor.in_frame(frame, (260, 210, 690))
    assert not loads
    for _ in range(2):
        np.testing.assert_allclose(predictor.in_frame(frame).center_mm, (30, -20, 700))
    assert len(loads) == 1 and predictor.finder is loads[0]


def test_where_to_start(seeing: netlib.Net, frame: np.ndarray) -> None:
    """The start is a pixel with the depth around it, or a given place; without a finder one must be given."""
    predictor = Predictor(seeing, KINECT2, refine=0)
    np.testing.assert_array_equal(predictor.in_frame(frame, (260, 210)).center_uvd, depth_around(frame, 260, 210))
    np.testing.assert_array_equal(predictor.in_frame(frame, (260, 210, 700)).center_uvd, [260, 210, 700])
    with pytest.raises(DataError, match=r"^this predictor has no finder; give the hand's place \(center\)$"):
        predictor.in_frame(frame)


def test_frames_of_other_sizes(seeing: netlib.Net, frame: np.ndarray) -> None:
    """A camera without a size accepts any frame."""
    own = Camera("own", KINECT2.fx, KINECT2.fy, KINECT2.u0, KINECT2.v0, 0, 0)
    found, same = (Predictor(seeing, camera).in_frame(frame, (260, 210)) for camera in (own, KINECT2))
    np.testing.assert_array_equal(found.joints, same.joints)
    assert (found.camera.width, found.camera.height) == (512, 424)


# ------------------------------------------------------------------------------------------------ places


def test_the_hand_with_the_highest_presence(seeing: netlib.Net, frame: np.ndarray) -> None:
    """Without a fit it is taken; a given place is not looked for."""
    said = Said(found_at(frame, (30.0, -20, 700)), found_at(frame, (0, 0, 900), 0.5))
    predictor = Predictor(seeing, KINECT2, refine=0, finder=said)
    found = predictor.in_frame(frame)
    np.testing.assert_allclose(found.center_mm, said.said[0].middle)
    assert found.presence == 0.9
    given = predictor.in_frame(frame, (260, 210, 690))
    assert given.center_uvd.tolist() == [260, 210, 690] and np.isnan(given.presence)


def test_where_nothing_is_found(seeing: netlib.Net, frame: np.ndarray) -> None:
    predictor = Predictor(seeing, KINECT2, refine=0, finder=Said())
    with pytest.raises(DataError, match=r"no hand is seen in this frame; .* give its place \(center\)"):
        predictor.in_frame(frame)


def test_of_found_hands_the_one_with_a_sure_pose(frame: np.ndarray) -> None:
    """Also if another place is more likely a hand."""
    predictor = load_predictor(KINECT2, fit="fast", hand="right")
    hand, wall = found_at(frame, (30.0, -20, 700), 0.5), found_at(frame, (-250.0, 100, 1480), 0.7)
    predictor.finder = Said(wall, hand)
    found = predictor.in_frame(frame)
    assert np.linalg.norm(found.center_mm - hand.middle) < 60 and found.presence == 0.5


# ----------------------------------------------------------------------------------------------- options


WHOLE = "expected a whole number from 0 to 100"


@bad_inputs(NetlibError, {
    line: (option, line) for option, line in (
        ({"hand": "Left"}, "hand='Left' (did you mean 'left'?); expected right, left, either"),
        ({"hand": None}, "hand=None; expected right, left, either"),
        ({"fit": "best"}, "fit='best'; expected no, fast, accurate"),
        ({"refine": -1}, f"refine=-1; {WHOLE}"),
        ({"refine": 1.5}, f"refine=1.5; {WHOLE}"),
        ({"refine": 10**9}, f"refine=1000000000; {WHOLE}"),
        ({"cube_mm": 0.3}, "cube_mm=0.3; expected 50 to 10000 mm"),
        ({"cube_mm": np.nan}, "cube_mm=nan; expected 50 to 10000 mm"),
        ({"cube_mm": "300"}, "cube_mm='300'; expected 50 to 10000 mm"),
        ({"min_confidence": 30}, "min_confidence=30; expected a number from 0 to 1"),
        ({"min_confidence": np.nan}, "min_confidence=nan; expected a number from 0 to 1"))
})
def test_options_that_are_none(seeing: netlib.Net, given: dict[str, Any], rejected: Any) -> None:
    """An invalid option raises an error at construction, also with the packaged weights."""
    for make in (lambda: Predictor(seeing, **given), lambda: load_predictor(**given)):
        with rejected:
            make()
