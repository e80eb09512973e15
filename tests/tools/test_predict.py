"""tools/predict.py: joints and a picture for each crop or full frame."""

import csv
import json
import re
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

import netlib
from handpose import read_track
from handpose.body.model import FINGERS
from handpose.body.nyu import EVALUATION_JOINTS
from handpose.estimate import packaged, predictor
from handpose.frames import camera_file
from handpose.frames.cameras import KINECT2
from handpose.frames.recording import CameraInfo
from handpose.output.drawing.view import percent
from handpose.output.tracks import joint_values
from handpose.sequences.recordings import render_image
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton as skeletons
from layers.hand.kinematics import Kinematics
from netlib import engine
from netlib.errors import DataError
from tests.handpose.drawn_hands import ARM_BEHIND, capsules_of
from tests.support import json_schema
from tests.support.nets import inputs, ip
from tests.support.running import refusal, run_tool
from tests.tools.conftest import ROOT, mistakes_of

OWN = "--weights net.caffemodel.h5 --fit no"  # the user's network without a fit
KINECT = "--camera kinect2"
# on the hand in frame.png, which the finder then does not look for
CENTER = "--center 271,217"
# before joints
COLUMNS = [
    "image",
    "hand",
    "presence",
    "confidence",
    "error_mm",
    *(f"{finger}_error_mm" for finger in FINGERS),
]


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """A file of weights as the fillers draw them."""
    path = tmp_path_factory.mktemp("weights") / "net.caffemodel.h5"
    netlib.Net(ROOT / "prototxt" / "nyu_deploy.prototxt", netlib.TEST, seed=1).save(path)
    return path


@pytest.fixture
def snapshot(here, weights, rng):
    """Write net.caffemodel.h5 and crop.png to the working directory."""
    shutil.copy(weights, "net.caffemodel.h5")
    cv2.imwrite("crop.png", rng.integers(0, 256, (128, 128), dtype=np.uint8))


def rendered(prior=None, seed=1):
    """The depth in mm of a hand 700 mm from a Kinect v2, with 0 as background, and the hand."""
    sampler, rng = BodySampler(prior), np.random.default_rng(seed)
    hand = sampler.draw(rng, 1)
    depth = render_image(capsules_of(sampler, rng, hand, (30, -20, 700), ARM_BEHIND), KINECT2)[0]
    return np.where(np.isfinite(depth), depth, 0).astype(np.uint16), hand


@pytest.fixture(scope="module")
def before_kinect():
    return rendered()[0]


@pytest.fixture
def frame(snapshot, before_kinect):
    """Write frame.png, a 16-bit frame in mm of a hand 700 mm from a Kinect v2 before a wall;
    return its depth.
    """
    depth = before_kinect.copy()
    depth[depth == 0] = 1500
    depth[:50] = 0
    cv2.imwrite("frame.png", depth)
    return depth


def hands_of(text):
    """The hands of a valid document, each with the keys of its frame and crop, and its
    joints by name.
    """
    document = json.loads(text)
    assert not json_schema.faults(document)
    names = document["skeleton"]["joints"]
    return [
        {**frame, **hand, **hand["crop"], "joints": dict(zip(names, hand["positions_mm"]))}
        for frame in document["frames"]
        for hand in frame["hands"]
    ]


def predict(options):
    return run_tool(f"predict {OWN} --out p {options}")


def predicted(options):
    """Return the hand of each image in the tool's JSON output."""
    return hands_of(predict(f"--json - {options}").out)


def mistake(options):
    return refusal(f"predict {OWN} {options}")


def table(path):
    return list(csv.DictReader(Path(path).read_text(encoding="utf-8").splitlines()))


# ------------------------------------------------------------------------------------------- crops


def test_crops(snapshot):
    """Joints are in mm, scaled by the cube; without frames and a fit, JSON has neither a
    camera nor angles.
    """
    text = predict("crop.png crop.png --json -").out
    lines = predict("crop.png crop.png --json a.json").out
    assert lines.startswith("crop.png: ")
    assert Path("a.json").read_text() == text
    document, (first, second) = json.loads(text), hands_of(text)
    assert document["camera"] is None
    assert document["source"] == "2 images"
    assert [found["number"] for found in (first, second)] == [0, 1]
    assert first["time_s"] is second["time_s"] is None
    unknown = {"presence", "confidence", "error_mm", "angles_rad", "translations_mm", "bones_mm"}
    hand = document["frames"][0]["hands"][0]
    assert {key for key, value in hand.items() if value is None} == unknown
    assert first["origin_mm"] == [0, 0, 0]
    assert first["crop"] == {"center_uvd": None, "cube_mm": 300}
    assert cv2.imread(first["picture"]) is not None
    assert first["picture"] == "p/crop_hand.png"
    assert len(first["joints"]) == 31
    assert first["image"] == "crop.png"
    (smaller,) = predicted("crop.png --cube 261")
    assert smaller["joints"]["palm"] == pytest.approx(
        np.array(first["joints"]["palm"]) * 0.87, abs=0.02
    )
    with pytest.raises(DataError, match="predicted from crops without a camera"):
        read_track("a.json")


def test_engine(snapshot, monkeypatch):
    """--engine selects the engine, and the joints agree to rounding."""
    nets, names = [], ["plain", *(["fast"] if engine.has_fast() else [])]
    monkeypatch.setattr(
        "netlib.training.trained.Net",
        lambda *args, **options: nets.append(netlib.Net(*args, **options)) or nets[-1],
    )
    found = [predicted(f"crop.png --engine {name}")[0]["positions_mm"] for name in names]
    assert [net.engine.name for net in nets] == names  # crops need no finder
    assert np.allclose(found[0], found[-1], atol=0.02)  # mm


def test_another_format_of_a_crop(snapshot):
    """Landmarks are relative to the crop's image, metric joints to its centre; --csv has the
    columns of a track.
    """
    (found,) = predicted("crop.png --joints mediapipe --csv hands.csv")
    x, y, _ = found["mediapipe"]["landmarks"][4]
    right, up, _ = found["joints"]["thumb_tip"]
    assert (x, y) == pytest.approx((0.5 + right / 300, 0.5 - up / 300), abs=1e-4)
    (row,) = table("hands.csv")
    assert list(row) == [*COLUMNS, *joint_values.columns("mediapipe")]
    parts = [*found["mediapipe"].values(), list(found["anatomical_deg"].values())]
    expected = np.concatenate([np.ravel(part) for part in parts])
    numbers = [float(value) for value in list(row.values())[len(COLUMNS) :]]
    assert numbers == pytest.approx(expected.tolist(), abs=1e-4)


# ------------------------------------------------------------------------------------- whole frames


def test_a_whole_frame(frame):
    """The most likely position is cropped; the centre is given in px and in mm, and joints
    from the camera.
    """
    options = f"frame.png {KINECT} --json hands.json --csv hands.csv --refine 0"
    first, *joints = predict(options).out.splitlines()
    place = r"at -?\d+, -?\d+, \d{3} mm"
    assert re.fullmatch(
        f"frame.png: right hand; {place}, joints in mm from the camera, cube 300 mm; picture .*",
        first,
    )
    assert len(joints) == 31
    depths = [float(line.split()[-1]) for line in joints]
    assert min(depths) > 400
    assert max(depths) < 1000
    (found,) = hands_of(Path("hands.json").read_text())
    center = KINECT2.project(packaged.load_finder().hands(frame, KINECT2)[0].middle)
    assert found["center_uvd"] == pytest.approx(center, abs=0.01)
    truth = rendered()[1].joints[0].mean(axis=0) * 150 + (30, -20, 700)
    assert found["origin_mm"] == pytest.approx(truth, abs=30)
    (row,) = table("hands.csv")
    assert (row["image"], row["hand"]) == ("frame.png", "right")
    assert float(row["presence"]) > 0.1
    assert row["confidence"] == row["error_mm"] == ""
    numbers = [float(row[f"{name}_{axis}_mm"]) for name in found["joints"] for axis in "xyz"]
    assert numbers == pytest.approx(np.ravel(found["positions_mm"]), abs=0.011)
    assert len(row) == 5 + 5 + 93  # without a fit there are no angles


def test_json_of_frames_is_read_as_a_track(frame):
    """Frames are read like those of a track, with NaN for what only a fit determines; their
    sizes may differ.
    """
    cv2.imwrite("smaller.png", frame[:-8])
    camera = "--camera 363.9,363.9,255.4,206.3 --center 255,206,700"
    text = predict(f"frame.png smaller.png {camera} --json -").out
    Path("a.json").write_text(text)
    track = read_track("a.json")
    assert (track.header.camera.width, track.header.camera.fx, track.header.smoothed) == (
        0,
        363.9,
        False,
    )
    for found, hand in zip(track.frames, hands_of(text), strict=True):
        assert np.isnan(found.time)
        assert np.isnan(found.hands[0].pose.inputs).any()
        assert found.hands[0].xyz.tolist() == hand["positions_mm"]


@pytest.mark.parametrize(("name", "count"), [("mediapipe", 21), ("mano", 21), ("nyu", 14)])
def test_joints_of_another_format(frame, name, count):
    """With --joints JSON has the other format in addition; the table shows its joints and
    angles instead.
    """
    options = f"frame.png {KINECT} {CENTER} --joints {name} --json hands.json"
    lines = predict(options).out.splitlines()
    (found,) = hands_of(Path("hands.json").read_text())
    assert len(found["positions_mm"]) == 31
    assert len(found["anatomical_deg"]) == 20
    assert {len(values) for key, values in found[name].items() if key != "center_m"} == {count}
    assert len(lines) == 1 + 1 + count + 20
    assert lines[-1].split()[0] == "little_dip_flexion"
    about = "about its mean" if name == "mediapipe" else "from the camera"
    assert lines[1].startswith(f"  {name}: ")
    assert lines[1].endswith(about)
    key, digits = {"mediapipe": ("landmarks", 4), "nyu": ("positions_mm", 1)}.get(
        name, ("positions_m", 4)
    )
    assert lines[2].split()[1:4] == [f"{value:.{digits}f}" for value in found[name][key][0]]


def test_centers(frame):
    """U,V,D is used unchanged; for U,V the depth is read from the image, without the lens's
    distortion; each image may have its own centre.
    """
    v, u = (int(np.median(where)) for where in np.nonzero((frame > 0) & (frame < 800)))
    (found,) = predicted(f"frame.png {KINECT} --refine 0 --center {u},{v}")
    assert found["center_uvd"] == pytest.approx(predictor.depth_around(frame, u, v), abs=0.01)
    centers = [[250, 200, 690], [260, 210, 700]]
    for given in (centers[:1], centers):
        options = " ".join(f"--center={u},{v},{d}" for u, v, d in given)
        both = predicted(f"frame.png frame.png {KINECT} --refine 0 {options}")
        assert [found["center_uvd"] for found in both] == [given[0], given[-1]]
    assert [hand["picture"] for hand in both] == ["p/frame_hand.png", "p/frame_2_hand.png"]
    assert not np.array_equal(*(cv2.imread(hand["picture"]) for hand in both))
    cv2.imwrite("slope.png", np.tile(np.arange(800, 800 + 512, dtype=np.uint16), (424, 1)))
    slope = f"slope.png {KINECT} --refine 0 --center 450,300"
    (straight,), (bent,) = predicted(slope), predicted(f"{slope} --distortion=-0.1,0.05,0,0")
    assert straight["center_uvd"] != bent["center_uvd"]  # the depth there is another


def test_the_crop_is_moved_as_often_as_refine_says(frame, monkeypatch):
    cameras = []
    monkeypatch.setattr(
        "handpose.estimate.estimator.recenter",
        lambda *given: cameras.append(given[-1]) or given[2] + (5, 0, 0),
    )
    for hand, times, way in (("left", 1, -1), ("right", 3, 1), ("right", 0, 1)):
        options = f"--center 250,200,700 --hand {hand} --refine {times}"
        (found,) = predicted(f"frame.png {KINECT} {options}")
        assert found["center_uvd"] == [250 + way * 5 * times, 200, 700]
    assert [camera == KINECT2 for camera in cameras] == [False, True, True, True]


# ----------------------------------------------------------------------------------------- mistakes


IMAGES = {
    "flat.png": np.zeros((480, 640), np.uint8),
    "deep.png": np.zeros((128, 128), np.uint16),
    "empty.png": np.zeros((424, 512), np.uint16),
    "wall.png": np.full((424, 512), 700, np.uint16),
    "grey.png": np.ones((424, 512), np.uint8),
}


@mistakes_of("predict")
def test_mistakes(snapshot, argv, message):
    """An input or an output that cannot be used gives one line, and no picture is written."""
    for name, image in IMAGES.items():
        cv2.imwrite(name, image)
    for folder in ("a", "b"):
        Path(folder).mkdir()
        shutil.copy("crop.png", f"{folder}/x.png")
    shutil.copy("crop.png", "x_hand.png")
    Path("unit.json").write_text('{"unit_mm": 1}')
    assert mistake(argv).startswith(message)


def test_weights_of_another_net(snapshot):
    Path("other.prototxt").write_text(inputs(x=(1, 2)) + ip("other", "x", "y"))
    netlib.Net("other.prototxt", netlib.TEST).save("other.caffemodel.h5")
    line = mistake("crop.png --weights other.caffemodel.h5")
    assert line.startswith("other.caffemodel.h5: it has no layer of net 'DeepModel'; it has other,")
    assert line.endswith("nyu_deploy.prototxt: give that of these weights with --model")


def test_a_likely_wrong_unit_or_camera_is_reported(frame):
    """If no hand is found, the error names the unit that may be wrong; an implausible camera
    gives a warning.
    """
    cv2.imwrite("fifths.png", frame * 5)
    assert re.search("the unit, 1 mm, may be wrong: .*--unit 0.2 ", mistake(f"fifths.png {KINECT}"))
    cv2.imwrite("swapped.png", frame.astype(np.uint16).byteswap())
    assert "likely depths of the other byte order" in mistake(f"swapped.png {KINECT}")
    for camera, count in (("kinect2", 0), ("5,5,255.4,206.3", 1)):
        done = predict(f"frame.png --camera {camera} --center 260,210,700")
        lines = done.err.splitlines()
        assert all(line.startswith("warning: frame.png: ") for line in lines)
        assert sum("check fx and fy" in line for line in lines) == count


def test_an_image_that_is_missing_or_without_a_hand_does_not_end_the_run(frame):
    """The outputs are of the other images, and the exit status is that of an error."""
    cv2.imwrite("empty.png", IMAGES["empty.png"])
    options = f"empty.png frame.png no.png {KINECT} {CENTER} --json a.json --csv a.csv"
    done = run_tool(f"predict {OWN} --out p {options}", status=1)
    assert done.err.startswith("empty.png: no depth around pixel 271, 217")
    assert "\nno.png: cannot read the picture: No such file" in done.err
    (found,) = hands_of(Path("a.json").read_text())
    assert (found["image"], found["picture"]) == ("frame.png", "p/frame_hand.png")
    assert [row["image"] for row in table("a.csv")] == ["frame.png"]


def test_an_implausible_camera_is_reported_with_the_error(frame):
    cv2.imwrite("empty.png", IMAGES["empty.png"])
    """The size of the frame counts, which four numbers do not give."""
    assert "check fx and fy" in mistake("empty.png --camera 5,5,255.4,206.3")
    assert "check" not in mistake("empty.png --camera 364,364,255.4,206.3")


def test_a_frame_aligned_to_colours(frame):
    """A file with a camera may hold that of depth; a camera.json and four numbers were chosen."""
    shutil.copy("frame.png", "aligned_depth_to_color.png")
    Path("both.json").write_text('{"fx": 364, "fy": 364, "cx": 255.4, "cy": 206.3}')
    camera_file.write(Path("camera.json"), CameraInfo(KINECT2))
    given = ("both.json", True), ("camera.json", False), ("364,364,255.4,206.3", False)
    for camera, is_warned in given:
        done = predict(f"aligned_depth_to_color.png --camera {camera} {CENTER}")
        assert ("is aligned to another camera" in done.err) == is_warned


def test_a_name_that_says_disparities(frame):
    shutil.copy("frame.png", "disparity.png")
    done = predict(f"disparity.png frame.png {KINECT} {CENTER}")
    assert done.err.startswith("warning: disparity.png: the name says disparities or infrared")
    assert done.err.count("the name says") == 1


# --------------------------------------------------------------------------- a page for the browser


def hands_in(page):
    """Return the hands of a page, each with the joints (K, 3) in mm computed from its inputs."""
    text = Path(page).read_text(encoding="utf-8")
    data = json.loads(re.search(r'id="data">(.*?)</script>', text)[1])
    hands, (shown,) = data["hands"], data["bodies"]
    skeleton = skeletons.load(skeletons.NYU_HAND.with_name(f"{shown['name']}.prototxt"))
    for hand in hands:
        inputs = np.array([hand["inputs"][: len(skeleton.dof_names)]])
        joints = Kinematics(skeleton).joints(inputs, skeleton.bones[None] * hand["size"])[0]
        hand["joints"] = (
            joints * hand["place"]["unit_mm"] * (-1 if hand["side"] == "left" else 1, 1, 1)
        )
    return hands


def test_a_page_of_crops(snapshot):
    """The page has all images, and its inputs give the printed joints for either
    hand and any cube.
    """
    cv2.imwrite("b.png", np.random.default_rng(1).integers(0, 256, (128, 128), dtype=np.uint8))
    for side, cube in (("right", 300), ("left", 250)):
        printed = predicted(f"crop.png b.png --html page.html --hand {side} --cube {cube}")
        shown = hands_in("page.html")
        assert [hand["name"] for hand in shown] == ["crop.png", "b.png"]
        for found, hand in zip(printed, shown):
            assert (hand["side"], hand["place"]["cube_mm"], hand["words"]) == (
                side,
                cube,
                f"{side} hand",
            )
            assert_allclose(hand["joints"], found["positions_mm"], atol=0.02)


# ----------------------------------------------------------------------------- the packaged weights


def test_a_hand_below_the_minimum_confidence(frame):
    """The line, the table, JSON and CSV have its confidence and place, and no joints; there is
    nothing for a page.
    """
    command = f"predict frame.png {CENTER} {KINECT} --fit fast --hand right --out p"
    (hand,) = hands_of(run_tool(f"{command} --min-confidence 0 --json -").out)
    assert hand["confidence"] < 1
    command += " --min-confidence 1 --json x.json --csv x.csv --html x.html"
    for joints in ("", "--joints mano"):
        done = run_tool(f"{command} {joints}", status=1)
        (line,) = done.out.splitlines()
        assert f"{percent(hand['confidence'])} sure" in line
        assert "no joints below 100% (--min-confidence), cube" in line
        assert (
            "x.html: not written: nothing has joints, which need a confidence of at least 100%"
            in done.err
        )
        [found] = json.loads(Path("x.json").read_text())["frames"]
        [present] = found["hands"]
        assert present["palm_mm"] == pytest.approx(hand["origin_mm"], abs=0.06)
        assert present["positions_mm"] is None
        assert present["reason"] == f"the pose is uncertain (confidence {hand['confidence']:.0%})"
        (row,) = table("x.csv")
        assert float(row["confidence"]) == pytest.approx(hand["confidence"], abs=1e-4)
        assert row["hand"] == "right"
        assert len(row) > 60
        assert not any(value for key, value in row.items() if key not in COLUMNS)
    assert cv2.imread(found["picture"]).shape[1] < 2 * 512  # the crop alone
    assert read_track("x.json").frames[0].present[0].reason == present["reason"]


def test_a_hand_with_the_packaged_weights(here):
    """A fitted hand has the correct side, an expected error, and 14 joints within 2 cm of the
    truth on average.
    """
    depth, hand = rendered(prior_file.load(prior_file.PEOPLE_PRIOR), seed=3)
    cv2.imwrite("frame.png", depth)
    command = f"predict frame.png {CENTER},700 {KINECT} --out p --html page.html --csv hand.csv"
    (found,) = hands_of(text := run_tool(f"{command} --json -").out)
    assert found["hand"] == "right"
    assert found["error_mm"] < 16
    assert found["confidence"] > 0.9
    joints = np.array(found["positions_mm"])
    truth = hand.joints[0] * 150 + (30, -20, 700)
    assert np.linalg.norm(joints - truth, axis=1)[list(EVALUATION_JOINTS)].mean() < 20
    (row,) = table("hand.csv")
    assert float(row["error_mm"]) == pytest.approx(found["error_mm"], abs=0.0051)
    for finger, error in found["finger_error_mm"].items():
        assert 0 < error < 30
        assert float(row[f"{finger}_error_mm"]) == pytest.approx(error, abs=0.051)
    assert len(row) == 5 + 5 + 93 + 23
    assert all(value for name, value in row.items() if name != "presence")
    (shown,) = hands_in("page.html")
    assert_allclose(shown["joints"] + found["origin_mm"], joints, atol=0.02)
    assert shown["place"]["center_uvd"] == pytest.approx(found["center_uvd"], abs=0.01)
    assert shown["place"]["camera"]["fx"] == KINECT2.fx
    assert shown["crop"]
    Path("track.json").write_text(text)
    assert_allclose(
        shown["inputs"][:47], read_track("track.json").frames[0].hands[0].pose.inputs, atol=1e-5
    )
    assert len(shown["inputs"]) == 52
    assert np.any(shown["inputs"][47:])
    assert shown["thickness"] != 1
    height, width, _ = cv2.imread("p/frame_hand.png").shape
    assert width > 3 * 512
    assert height > 512 + 22
    first = run_tool(f"{command} --fit fast --hand right").out.splitlines()[0]
    assert re.match(
        r"frame.png: right hand, (>99|\d+)% sure, \d+ mm of error expected; at -?\d+, ", first
    )
