"""handpose/predicting/predictor.py: from Python, on crops and on whole frames."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import netlib
from handpose.data.crops import crop
from handpose.data.depth_images import UnitError
from handpose.facts.cameras import KINECT2, NYU, Camera
from handpose.facts.nyu import CENTER_IN_PALM, CUBE_MM
from handpose.facts.sides import Side, mirror_of
from handpose.predicting import finding
from handpose.predicting.locator import Located, Locator
from handpose.predicting.nets import best_fit, skeleton_to_fit
from handpose.predicting.packaged import load_predictor
from handpose.predicting.predictor import LARGEST_MOVE_MM, Predictor
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from handpose.synthetic.scenes import draw_scenes
from layers.hand import skeleton
from layers.hand.bodies import kinematics_of
from netlib.errors import DataError, NetlibError
from tests.handpose.whole_images import ARM_BEHIND, capsules_of, render_image

HAND = skeleton.load()
NET = """
layer { name: "in" type: "Input" top: "depth" input_param { shape { dim: %d dim: 1 dim: 128 dim: 128 } } }
layer { name: "DoF" type: "InnerProduct" bottom: "depth" top: "DoF"
        inner_product_param { num_output: 47 weight_filler { type: "gaussian" std: 0.003 } } }
layer { name: "hand" type: "HandModel" bottom: "DoF" top: "pred" }
"""
NetOf = Callable[..., netlib.Net]


@pytest.fixture
def seeing(net_of: NetOf) -> netlib.Net:
    """A net whose joints depend on every pixel."""
    return net_of(NET % 1, netlib.TEST)


@pytest.fixture
def fixed(net_of: NetOf) -> Callable[..., netlib.Net]:
    """A net that sees the same hand in every crop: as training crops have it, and then so many mm beside."""

    def make(*beside: float) -> netlib.Net:
        prior = prior_file.load().but(center_jitter=0, center_jitter_wide=0, scale_std=0, bone_std=0)
        inputs = BodySampler(prior).draw(np.random.default_rng(0), 1).inputs[0]
        inputs[:3] += np.array(beside) / (CUBE_MM / 2)
        net = net_of(NET % 1, netlib.TEST)
        net.params["DoF"][0].data[...], net.params["DoF"][1].data[...] = 0, inputs
        return net

    return make


@pytest.fixture(scope="module")
def frame() -> np.ndarray:
    """Depth (424, 512) in mm of a hand some 700 mm before a Kinect v2 and a wall behind it."""
    sampler, rng = BodySampler(), np.random.default_rng(1)
    hand = sampler.draw(rng, 1)
    flesh = capsules_of(sampler, rng, hand, (30, -20, 700), ARM_BEHIND)
    return render_image(flesh, KINECT2, background=1500.0)[0]


def some_crop() -> np.ndarray:
    """Noise in [-1, 1]."""
    return np.random.default_rng(0).uniform(-1, 1, (128, 128)).astype(np.float32)


# ------------------------------------------------------------------------------------------------- crops


def test_a_crop(fixed: Callable[..., netlib.Net]) -> None:
    """The joints of the hand model, in half-cubes and in mm of this cube, and the crop beside them."""
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
    """The same joints as a forward pass of the net, whatever batch its file has; crops of float64 as well."""
    net = net_of(NET % batch, netlib.TEST)
    found = Predictor(net).in_crop(some_crop().astype(np.float64))
    again = net.forward(depth=some_crop()[None, None])["pred"].reshape(31, 3)
    np.testing.assert_array_equal(found.joints, again)
    assert not np.array_equal(Predictor(net).in_crop(-some_crop()).joints, found.joints)


def test_the_other_hand(seeing: netlib.Net) -> None:
    """The mirror image of what is seen in the mirrored crop."""
    left = Predictor(seeing, hand="left").in_crop(some_crop())
    right = Predictor(seeing).in_crop(some_crop()[:, ::-1])
    np.testing.assert_array_equal(left.joints, right.joints * (-1, 1, 1))
    np.testing.assert_array_equal(left.crop, some_crop())


def test_a_crop_of_another_shape(seeing: netlib.Net) -> None:
    """Is none."""
    with pytest.raises(DataError, match=r"crop of shape \(1, 128, 128\), expected \(128, 128\)"):
        Predictor(seeing).in_crop(some_crop()[None])


def test_weights_that_are_not_finite(fixed: Callable[..., netlib.Net]) -> None:
    """Never a picture of nothing."""
    net = fixed(0, 0, 0)
    net.params["DoF"][1].data[4] = np.nan
    with pytest.raises(NetlibError, match="predicts joints that are not finite; check its weights"):
        Predictor(net).in_crop(some_crop())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (NET.replace('"depth"', '"crop"'), "no blob 'depth'; expected a net with the input depth and the output pred"),
        (NET.replace('"pred"', '"joints"'), "no blob 'pred'; expected a net with the input depth and the output pred"),
        (NET[: NET.index('layer { name: "hand"')].replace('top: "DoF"', 'top: "pred"'), "no HandModel layer, so the"),
    ],
    ids=["depth", "pred", "hand"],
)
def test_nets_of_another_kind(net_of: NetOf, text: str, message: str) -> None:
    """Are refused when the predictor is made."""
    with pytest.raises(NetlibError, match=message):
        Predictor(net_of(text % 1, netlib.TEST))


SIZED = NET.replace('bottom: "DoF" top: "pred"', 'bottom: "DoF" bottom: "size" top: "pred"').replace(
    'layer { name: "hand"',
    """layer { name: "size" type: "InnerProduct" bottom: "depth" top: "size"
        inner_product_param { num_output: 1 bias_filler { type: "constant" value: 1.5 } } }
layer { name: "hand\"""",
)


def test_a_net_that_predicts_the_size(net_of: NetOf, tmp_path: Path) -> None:
    """Its joints are those of its layer, of the hand's own size; a fit, which has another size, is refused."""
    net = net_of(SIZED % 1, netlib.TEST)
    bias = net.params["DoF"][1].data
    net.params["DoF"][0].data[...], bias[...] = 0, -HAND.initial * HAND.slides * 1.5  # the palm in the middle
    found = Predictor(net).in_crop(some_crop())
    usual = HAND.scaled(1.5)
    assert np.allclose(found.joints, kinematics_of(usual).joints(bias[None].astype(float))[0], atol=1e-5)
    message = "layer 'hand' takes the size of each hand from blob 'size', which a fit does not know; do without a fit"
    with pytest.raises(NetlibError, match=message):
        Predictor(net, fit="fast").in_crop(some_crop())
    with pytest.raises(NetlibError, match=message):
        skeleton_to_fit(net)
    for text, expected in ((SIZED, "no"), (NET, "accurate")):
        (tmp_path / "net.prototxt").write_text(text % 1)
        assert best_fit(tmp_path / "net.prototxt") == expected


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"hand": "Left"}, r"hand='Left' \(did you mean 'left'\?\); expected right, left, either"),
        ({"hand": None}, "hand=None; expected right, left, either"),
        ({"fit": "best"}, "fit='best'; expected no, fast, accurate"),
        ({"refine": -1}, "refine=-1; expected a whole number from 0 to 100"),
        ({"refine": 1.5}, "refine=1.5; expected a whole number from 0 to 100"),
        ({"refine": 10**9}, "refine=1000000000; expected a whole number from 0 to 100"),
        ({"cube_mm": 0.3}, "cube_mm=0.3; expected 50 to 10000 mm"),
        ({"cube_mm": np.nan}, "cube_mm=nan; expected 50 to 10000 mm"),
        ({"cube_mm": "300"}, "cube_mm='300'; expected 50 to 10000 mm"),
    ],
    ids=str,
)
def test_options_that_are_none(seeing: netlib.Net, option: dict[str, Any], message: str) -> None:
    """Are refused when the predictor is made, by its name or with the packaged weights."""
    for make in (lambda: Predictor(seeing, **option), lambda: load_predictor(**option)):
        with pytest.raises(NetlibError, match=f"^{message}$"):
            make()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.arange(128 * 128).reshape(128, 128) % 256, "crop with values from 0 to 255, expected -1 to 1"),
        (np.full((128, 128), np.nan), "crop with values that are not numbers, expected -1 to 1"),
        (np.full((128, 128), -np.inf), "crop with values from -inf to -inf, expected -1 to 1"),
        ([[0.0]], "crop is a list, expected an array of numbers"),
        (np.full((128, 128), "a"), "crop is an array of <U1, expected numbers"),
    ],
    ids=["bytes", "nan", "infinite", "list", "text"],
)
def test_crops_with_other_values(seeing: netlib.Net, values: Any, message: str) -> None:
    """Say so, and do not blame the net."""
    with pytest.raises(DataError, match=message):
        Predictor(seeing).in_crop(values)


def test_a_masked_crop(seeing: netlib.Net) -> None:
    """What is masked is background."""
    shown = some_crop()
    shown[:20] = 1
    hidden = np.ma.array(some_crop(), mask=np.arange(128)[:, None] < np.full(128, 20))
    predictor = Predictor(seeing)
    np.testing.assert_array_equal(predictor.in_crop(hidden).joints, predictor.in_crop(shown).joints)


# ------------------------------------------------------------------------------------------------ frames


def test_a_masked_frame(seeing: netlib.Net, frame: np.ndarray) -> None:
    """What is masked was not read."""
    holes = np.where(frame > 1000, 0, frame)
    predictor = load_predictor(KINECT2, fit="fast", hand="right")
    for center in (None, (270, 215)):
        found, same = (predictor.in_frame(depth, center) for depth in (np.ma.masked_equal(holes, 0), holes))
        np.testing.assert_array_equal(found.xyz, same.xyz)
    hidden = np.ma.array(frame, mask=frame > 1000)
    np.testing.assert_array_equal(
        crop(hidden, (270, 215, 700), 300, KINECT2), crop(holes, (270, 215, 700), 300, KINECT2)
    )


def test_a_hand_behind_the_camera(fixed: Callable[..., netlib.Net], frame: np.ndarray) -> None:
    """Is never told."""
    with pytest.raises(
        DataError, match=r"a hand is predicted in which a joint is at a depth of -\d+ mm, behind the camera"
    ):
        Predictor(fixed(0, 0, -140), KINECT2, refine=0).in_frame(frame, (260, 210, 160))


@pytest.mark.parametrize(
    "center", [(np.nan, 200), (300,), (1, 2, 3, 4), (1, 2, np.inf), "palm", ((1, 2), (3, 4))], ids=str
)
def test_centers_that_are_none(seeing: netlib.Net, frame: np.ndarray, center: Any) -> None:
    """Two or three finite numbers are one."""
    with pytest.raises(DataError, match=r"expected two or three finite numbers: u, v in px or u, v, d in px, px, mm"):
        Predictor(seeing, KINECT2).in_frame(frame, center)


@pytest.mark.parametrize("center", [None, (260, 210, 700)], ids=["searched", "given"])
def test_a_frame_in_another_unit(seeing: netlib.Net, frame: np.ndarray, center: Any) -> None:
    """Is refused wherever one looks."""
    for factor in (0.001, 1000, -1):
        with pytest.raises(UnitError, match="expected mm"):
            Predictor(seeing, KINECT2).in_frame(frame * factor, center)


def test_a_crop_at_rest_is_looked_at_once(
    seeing: netlib.Net, frame: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However often it may be moved."""
    looks: list[int] = []
    monkeypatch.setattr(finding, "recenter", lambda joints, skeleton, center, *rest: looks.append(1) or center.copy())
    found = Predictor(seeing, KINECT2, refine=100).in_frame(frame, (260, 210, 690))
    assert len(looks) == 1 and found.center_uvd.tolist() == [260, 210, 690]


def test_a_frame_with_its_centre(seeing: netlib.Net, frame: np.ndarray) -> None:
    """Without refinement: the joints of the crop at this centre, and where they are before the camera."""
    center = [260.0, 210.0, 690.0]
    found = Predictor(seeing, KINECT2, refine=0).in_frame(frame, center)
    np.testing.assert_array_equal(found.crop, crop(frame, center, CUBE_MM, KINECT2))
    np.testing.assert_array_equal(found.joints, Predictor(seeing).in_crop(found.crop).joints)
    np.testing.assert_array_equal(found.center_uvd, center)
    np.testing.assert_allclose(found.center_mm, KINECT2.unproject(center))
    np.testing.assert_allclose(found.xyz, KINECT2.unproject(center) + found.joints * 150)
    assert found.camera == KINECT2


def test_where_to_start(seeing: netlib.Net, frame: np.ndarray) -> None:
    """At the nearest thing, at a pixel and what is seen there, or at a place that is given."""
    predictor = Predictor(seeing, KINECT2, refine=0)
    nearest = finding.find_hand(frame, KINECT2)
    np.testing.assert_array_equal(predictor.in_frame(frame).center_uvd, nearest)
    assert KINECT2.unproject(nearest) == pytest.approx((30, -20, 700), abs=60)
    u, v, _ = nearest
    np.testing.assert_array_equal(predictor.start(frame, (u, v)), finding.depth_around(frame, u, v))
    np.testing.assert_array_equal(predictor.start(frame, (1, 2, 3)), [1, 2, 3])
    with pytest.raises(DataError, match="no depth anywhere in the image"):
        predictor.in_frame(np.zeros((424, 512)))


@pytest.mark.parametrize("hand", ["right", "left"])
@pytest.mark.parametrize("refine", [0, 1, 2, 3])
def test_the_crop_goes_to_the_palm(
    fixed: Callable[..., netlib.Net], frame: np.ndarray, refine: int, hand: Side
) -> None:
    """Each time by as much as the hand is beside; then the joints are those of the last crop."""
    beside = np.array([10.0, -5.0, 4.0]) * mirror_of(hand)
    predictor = Predictor(fixed(10, -5, 4), KINECT2, refine=refine, hand=hand)
    start = np.array([260.0, 210.0, 690.0])
    found = predictor.in_frame(frame, start)
    np.testing.assert_allclose(found.center_mm, KINECT2.unproject(start) + refine * beside, atol=1e-3)
    np.testing.assert_array_equal(found.crop, crop(frame, found.center_uvd, CUBE_MM, KINECT2))


def test_a_crop_as_in_training_stays(fixed: Callable[..., netlib.Net], frame: np.ndarray) -> None:
    """Where the centre is at its place in the palm there is nothing to mend."""
    found = Predictor(fixed(0, 0, 0), KINECT2).in_frame(frame, (260, 210, 690))
    np.testing.assert_allclose(found.center_uvd, (260, 210, 690), atol=1e-3)
    palm = found.joints_mm[HAND.joint_names.index("palm")]
    assert np.linalg.norm(palm) == pytest.approx(np.linalg.norm(CENTER_IN_PALM), abs=1e-3)


def test_a_prediction_gone_astray(fixed: Callable[..., netlib.Net], frame: np.ndarray) -> None:
    """Moves the crop no farther than LARGEST_MOVE_MM, not out of the image, and not to the camera."""
    start = np.array([260.0, 210.0, 690.0])
    found = Predictor(fixed(25, 0, 0), KINECT2, refine=9).in_frame(frame, start)
    moved = np.linalg.norm(found.center_mm - KINECT2.unproject(start))
    assert moved == pytest.approx(50, abs=1e-3) and moved < LARGEST_MOVE_MM
    near = np.array([260.0, 210.0, 155.0])
    found = Predictor(fixed(0, 0, -20), KINECT2).in_frame(frame, near)
    np.testing.assert_array_equal(found.center_uvd, near)
    corner = np.array([-40.0, 210.0, 690.0])
    found = Predictor(fixed(-50, 0, 0), KINECT2, cube_mm=200).in_frame(frame, corner)
    np.testing.assert_array_equal(found.center_uvd, corner)


def test_frames_of_other_sizes(seeing: netlib.Net, frame: np.ndarray) -> None:
    """A camera without a size takes the frame's; another's frame is an error, and so is a picture in colours."""
    own = Camera("own", KINECT2.fx, KINECT2.fy, KINECT2.u0, KINECT2.v0, 0, 0)
    found, same = (Predictor(seeing, camera).in_frame(frame) for camera in (own, KINECT2))
    np.testing.assert_array_equal(found.joints, same.joints)
    assert (found.camera.width, found.camera.height) == (512, 424)
    with pytest.raises(DataError, match=r"depth image of shape \(424, 512\), expected \(480, 640\) of camera 'nyu'"):
        Predictor(seeing, NYU).in_frame(frame)
    with pytest.raises(DataError, match=r"depth image of shape \(424, 512, 1\), expected \(height, width\)"):
        Predictor(seeing, KINECT2).in_frame(frame[:, :, None])


# ------------------------------------------------------------------------------------------------ places


class Said(Locator):
    """A locator that says what it is told to say."""

    def __init__(self, center: np.ndarray, odds: np.ndarray) -> None:
        self.said = Located(center, odds)

    def hands(self, depth: np.ndarray, camera: Camera) -> Located:
        """Whatever is seen."""
        return self.said


def test_the_likeliest_place(seeing: netlib.Net, frame: np.ndarray) -> None:
    """Of a locator, without a fit, is where to look."""
    said = Said(np.array([[30.0, -20, 700], [0, 0, 900]]), np.array([3.0, 2]))
    predictor = Predictor(seeing, KINECT2, refine=0, locator=said)
    np.testing.assert_allclose(predictor.start(frame), KINECT2.project(said.said.center[0]))
    np.testing.assert_allclose(predictor.in_frame(frame).center_mm, said.said.center[0])
    np.testing.assert_array_equal(predictor.in_frame(frame, (260, 210, 690)).center_uvd, (260, 210, 690))


def test_the_place_that_looks_most_like_a_hand(frame: np.ndarray) -> None:
    """Where the fit explains what is seen, though the locator found the wall likelier; from beside the hand, too."""
    predictor = load_predictor(KINECT2, fit="fast", hand="right")
    hand, wall = np.array([30.0, -20, 700]), np.array([-250.0, 100, 1480])
    for beside in ((0, 0, 0), (25, 0, 0)):
        predictor.locator = Said(np.stack([wall, hand + beside]), np.array([1.0, 0]))
        found = predictor.in_frame(frame)
        assert np.linalg.norm(found.center_mm - hand) < 60
    predictor.locator = Said(np.array([[9000.0, 0, 700], [30, -20, 700]]), np.array([1.0, 0]))  # one is out of sight
    assert np.linalg.norm(predictor.in_frame(frame).center_mm - hand) < 60
    predictor.locator = Said(np.array([[9000.0, 0, 700]]), np.array([1.0]))
    with pytest.raises(DataError, match="lies outside the image"):
        predictor.in_frame(frame)


def test_a_speck_is_no_hand() -> None:
    """Nothing contradicts a hand where little is to be seen: not the doubt chooses between places."""
    depth = draw_scenes(np.random.default_rng(77), 1).depth[0].copy()
    predictor = load_predictor(fit="fast", hand="right")
    hand = predictor.in_frame(depth).center_mm
    depth[:55, :55] = 400
    assert np.linalg.norm(predictor.in_frame(depth).center_mm - hand) < 30


def test_a_left_hand_is_the_mirror_image_of_a_right_one(frame: np.ndarray) -> None:
    """As little strange, also before a camera that does not look from the middle of its image."""
    part, strange = frame[:, 150:400], []
    for depth, u0, hand in ((part, KINECT2.u0 - 150, "right"), (part[:, ::-1], 249 - (KINECT2.u0 - 150), "left")):
        camera = Camera("part", KINECT2.fx, KINECT2.fy, u0, KINECT2.v0, 250, 424)
        predictor = load_predictor(camera, fit="fast", hand=hand)  # type: ignore[arg-type]
        center = camera.project(np.array([30.0, -20, 700]) * mirror_of(hand))
        found = predictor.in_frame(np.ascontiguousarray(depth), center)
        assert found.fit is not None and found.camera == camera
        strange.append(found.fit.strangeness)
    assert strange[0] == pytest.approx(strange[1], rel=0.1)


def test_frames_of_other_sizes_with_a_locator(frame: np.ndarray) -> None:
    """Are told by their shape, not by what is seen in them."""
    with pytest.raises(DataError, match=r"depth image of shape \(424, 512\), expected \(480, 640\) of camera 'nyu'"):
        load_predictor(NYU).in_frame(frame)


def test_the_next_place_if_the_likeliest_is_out_of_sight(seeing: netlib.Net, frame: np.ndarray) -> None:
    """Without a fit, too."""
    said = Said(np.array([[9000.0, 0, 700], [30, -20, 700]]), np.array([3.0, 2]))
    found = Predictor(seeing, KINECT2, refine=0, locator=said).in_frame(frame)
    np.testing.assert_allclose(found.center_mm, said.said.center[1])


def test_hands_at_places(frame: np.ndarray) -> None:
    """All of them, the likeliest first: by the fit, and by the odds of the locator; those out of sight are left out."""
    predictor = load_predictor(KINECT2, fit="fast", hand="right")
    hand, wall = KINECT2.project(np.array([[30.0, -20, 700], [-250, 100, 1480]]))
    away = KINECT2.project(np.array([9000.0, 0, 700]))
    found = predictor.hands_at(frame, [wall, away, hand], [0.0, 5.0, 0.0])
    assert len(found) >= 2 and np.linalg.norm(found[0].center_mm - (30, -20, 700)) < 60
    assert all(one.fit is not None and one.camera == KINECT2 for one in found)
    strange = [one.fit.strangeness for one in found if one.fit]
    assert strange[0] == min(strange)
    bribed = predictor.hands_at(frame, [wall, hand], [100.0, 0.0])
    assert np.linalg.norm(bribed[0].center_mm - (-250, 100, 1480)) < 100
    with pytest.raises(DataError, match="lies outside the image"):
        predictor.hands_at(frame, [away], [0.0])


def test_hands_as_in_a_whole_frame(frame: np.ndarray) -> None:
    """What is found at the places of the locator is what is found in the frame."""
    predictor = load_predictor(KINECT2, fit="fast", hand="right")
    assert predictor.locator is not None
    located = predictor.locator.hands(frame, KINECT2)
    one = predictor.hands_at(frame, list(KINECT2.project(located.center)), list(located.odds))[0]
    np.testing.assert_array_equal(one.joints, predictor.in_frame(frame).joints)


def test_a_hand_at_a_place_without_a_fit(seeing: netlib.Net, frame: np.ndarray) -> None:
    """The first one in sight, for nobody can choose."""
    away, there = KINECT2.project(np.array([[9000.0, 0, 700], [30, -20, 700]]))
    (found,) = Predictor(seeing, KINECT2, refine=0).hands_at(frame, [away, there], [1.0, 0.0])
    np.testing.assert_array_equal(found.center_uvd, there)
