"""tools/predict.py: joints and a picture for each crop or full frame."""

import base64
import csv
import json
import re
import shutil
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

import netlib
from handpose import read_track
from handpose.body.fingers import FINGERS
from handpose.body.nyu import CUBE_MM, EVALUATION_JOINTS
from handpose.estimate import locator, packaged, pipeline
from handpose.frames.cameras import KINECT2, NYU, SR305, Camera
from handpose.frames.crops import crop
from handpose.frames.images import pack_depth, read_crop, read_frame
from handpose.frames.recording import CameraInfo
from handpose.output.drawing.view import percent
from handpose.output.hand_page.content import skeleton_values
from handpose.output.tracks import joint_values
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from handpose.tracking.track import joints_of
from layers.hand import skeleton as skeletons
from layers.hand.kinematics import Kinematics
from netlib import engine
from netlib.errors import DataError
from tests.handpose.whole_images import ARM_BEHIND, capsules_of, render_image
from tests.support import json_schema
from tests.support.running import run_tool
from tests.tools.conftest import ROOT

OWN = ["--weights", "net.caffemodel.h5", "--fit", "no"]  # the user's network without a fit
CENTER = ["--center", "271,217"]  # on the hand in frame.png, which the locator then does not look for


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """A file of weights as the fillers draw them."""
    path = tmp_path_factory.mktemp("weights") / "net.caffemodel.h5"
    netlib.Net(ROOT / "prototxt" / "nyu_deploy.prototxt", netlib.TEST, seed=1).save(path)
    return path


@pytest.fixture
def snapshot(tmp_path, monkeypatch, weights):
    monkeypatch.chdir(tmp_path)
    shutil.copy(weights, "net.caffemodel.h5")
    rng = np.random.default_rng(0)
    cv2.imwrite("crop.png", rng.integers(0, 256, (128, 128), dtype=np.uint8))
    return "net.caffemodel.h5"


def hands_of(text):
    """The hands of a valid document, each with the keys of its frame and crop, and its joints by name."""
    document = json.loads(text)
    assert not json_schema.faults(document)
    names = document["skeleton"]["joints"]
    return [
        {**frame, **hand, **hand["crop"], "joints": dict(zip(names, hand["positions_mm"]))}
        for frame in document["frames"]
        for hand in frame["hands"]
    ]


def test_joints_and_picture(snapshot):
    """JSON has 31 joints in mm, scaled by the cube, and the picture is written to --out."""
    (found,) = predicted("crop.png")
    assert cv2.imread(found["picture"]) is not None and found["picture"] == "p/crop_hand.png"
    assert len(found["joints"]) == 31 and found["image"] == "crop.png"
    (smaller,) = predicted("crop.png", "--cube", "261")
    assert smaller["joints"]["palm"] == pytest.approx(np.array(found["joints"]["palm"]) * 0.87, abs=0.02)


def test_json_of_crops(snapshot):
    """Without frames and a fit, JSON has neither a camera nor angles; each of the images is a frame."""
    document = json.loads(run_tool("predict", *OWN, "crop.png", "crop.png", "--out", "p", "--json").out)
    assert not json_schema.faults(document) and document["camera"] is None and document["source"] == "2 images"
    assert [(frame["number"], frame["time_s"]) for frame in document["frames"]] == [(0, None), (1, None)]
    (hand,) = document["frames"][0]["hands"]
    assert [key for key, value in hand.items() if value is None] == [
        "confidence", "error_mm", "angles_rad", "translations_mm", "bones_mm"
    ]
    assert hand["origin_mm"] == [0, 0, 0] and hand["crop"] == {"center_uvd": None, "cube_mm": 300}
    Path("a.json").write_text(json.dumps(document))
    with pytest.raises(DataError, match="predicted from crops without a camera"):
        read_track("a.json")


def test_json_to_a_file(snapshot):
    """--json FILE.json writes what --json prints, in addition to the table; an image may follow --json."""
    printed = run_tool("predict", *OWN, "--out", "p", "--json", "crop.png").out
    table = run_tool("predict", *OWN, "crop.png", "--out", "p", "--json", "hands.json").out
    assert table.startswith("crop.png: ") and Path("hands.json").read_text() == printed
    assert run_tool("predict", *OWN, "crop.png", "--out", "p", "--json", "-").out == printed
    assert "is read in this run" in run_tool("predict", *OWN, "c.json", "--json", "c.json", "--out", "p", status=1).err


def test_json_of_frames_is_read_as_a_track(frame):
    """Frames are read like those of a track, with NaN for what only a fit determines; their sizes may differ."""
    cv2.imwrite("smaller.png", frame[:-8])
    images = ["frame.png", "smaller.png", "--camera", "363.9,363.9,255.4,206.3", "--center", "255,206,700"]
    text = run_tool("predict", *OWN, *images, "--out", "p", "--json").out
    Path("a.json").write_text(text)
    track = read_track("a.json")
    assert (track.header.camera.width, track.header.camera.fx, track.header.smoothed) == (0, 363.9, False)
    for found, hand in zip(track.frames, hands_of(text), strict=True):
        assert np.isnan(found.time) and np.isnan(found.hands[0].inputs).any()
        assert found.hands[0].xyz.tolist() == hand["positions_mm"]
        np.testing.assert_allclose(found.hands[0].origin_mm, hand["origin_mm"])


def test_engine(snapshot, monkeypatch):
    """--engine selects the engine, and the joints agree to rounding."""
    names, nets, found = ["plain"] + (["fast"] if engine.has_fast() else []), [], []

    def built(*args, **options):
        nets.append(netlib.Net(*args, **options))
        return nets[-1]

    monkeypatch.setattr(packaged, "Net", built)
    monkeypatch.setenv("NETLIB_ENGINE", "plain")
    for chosen in ([], *(["--engine", name] for name in names)):
        done = run_tool("predict", *OWN, "crop.png", "--out", "p", "--json", *chosen)
        found.append(np.array(hands_of(done.out)[0]["positions_mm"]))
    assert [net.engine.name for net in nets] == ["plain", *names]  # crops need no locator
    assert all(np.allclose(joints, found[0], atol=0.02) for joints in found)  # mm
    assert "invalid choice: 'plane'" in run_tool("predict", *OWN, "crop.png", "--engine", "plane", status=2).err


def test_crop_is_normalised(snapshot):
    """Gray 0 is the near plane -1, 255 the far plane 1; other sizes are resized by nearest neighbour."""
    cv2.imwrite("two.png", np.kron(np.array([[0, 255]] * 2, np.uint8), np.ones((32, 32), np.uint8)))
    crop = read_crop("two.png")
    assert crop.shape == (128, 128)
    assert (crop[:, :64] == -1).all() and (crop[:, 64:] == 1).all()


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (None, "cannot read the picture: No such file or directory"),
        (np.zeros((480, 640), np.uint8), "640 x 480 pixels; expected a square crop"),
        (np.zeros((128, 128), np.uint16), "found uint16 (128, 128); expected an 8-bit grey picture"),
    ],
)
def test_mistakes(snapshot, image, message):
    """An image that is not a crop gives a one-line error."""
    if image is not None:
        cv2.imwrite("bad.png", image)
    assert message in run_tool("predict", *OWN, "bad.png", status=1).err


def test_no_picture_is_written_over(snapshot, tmp_path):
    """Two crops with the same name, or a crop with the name of an output, are rejected."""
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        cv2.imwrite(f"{folder}/x.png", np.zeros((128, 128), np.uint8))
    cv2.imwrite("x_hand.png", np.zeros((128, 128), np.uint8))
    before = (tmp_path / "x_hand.png").read_bytes()
    done = run_tool("predict", *OWN, "a/x.png", "b/x.png", "--out", "o", status=1)
    assert "b/x.png: its output o/x_hand.png would overwrite another one" in done.err
    done = run_tool("predict", *OWN, "a/x.png", "x_hand.png", status=1)
    assert "x_hand.png: is read in this run; expected another output" in done.err
    assert (tmp_path / "x_hand.png").read_bytes() == before


def test_weights_that_lack_a_layer(snapshot):
    """Weights that lack a layer are rejected, as the result would look valid."""
    with h5py.File(snapshot, "a") as file:
        del file["data/FC2"]
    assert "no weights for layer 'FC2' of net 'DeepModel'" in run_tool("predict", *OWN, "crop.png", status=1).err


# ------------------------------------------------------------------------------------------- whole frames


@pytest.fixture(scope="module")
def before_kinect():
    """The depth of a hand 700 mm from a Kinect v2."""
    return hand_before(KINECT2)


@pytest.fixture
def frame(snapshot, before_kinect):
    """Write frame.png, a 16-bit frame in mm of a hand 700 mm from a Kinect v2 before a wall; return its depth."""
    depth = before_kinect.copy()
    depth[depth == 0] = 1500
    depth[:50] = 0
    cv2.imwrite("frame.png", depth)
    return depth


def hand_before(camera):
    """Return the depth (height, width) in whole mm of a hand 700 mm from a camera, with 0 as background."""
    sampler, rng = BodySampler(), np.random.default_rng(1)
    hand = sampler.draw(rng, 1)
    surface = capsules_of(sampler, rng, hand, (30, -20, 700), ARM_BEHIND)
    depth = render_image(surface, camera)[0]
    return np.where(np.isfinite(depth), depth, 0).astype(np.uint16)


def predicted(*arguments):
    """Return the hand of each image in the tool's JSON output."""
    return hands_of(run_tool("predict", *OWN, "--out", "p", "--json", *arguments).out)


def mistake(*arguments):
    """Return the one line that an error prints."""
    lines = run_tool("predict", *OWN, *arguments, status=1).err.splitlines()
    assert len(lines) == 1, lines
    return lines[0]


def test_a_whole_frame(frame):
    """The most likely position is cropped; joints are those of the crop, and the centre is given in px and in mm."""
    (found,) = predicted("frame.png", "--camera", "kinect2", "--refine", "0")
    center = KINECT2.project(packaged.load_locator().hands(frame, KINECT2).center[0])
    assert found["center_uvd"] == pytest.approx(center, abs=0.01)
    assert found["origin_mm"] == pytest.approx(KINECT2.unproject(center), abs=0.01)
    assert found["origin_mm"] == pytest.approx((30, -20, 700), abs=60)
    net = netlib.Net(ROOT / "prototxt" / "nyu_deploy.prototxt", "net.caffemodel.h5", netlib.TEST)
    joints = net.forward(depth=crop(frame, center, CUBE_MM, KINECT2)[None, None])["pred"].reshape(31, 3) * CUBE_MM / 2
    assert np.array(found["positions_mm"]) == pytest.approx(joints + found["origin_mm"], abs=0.01)
    assert cv2.imread("p/frame_hand.png") is not None


def test_the_table_says_where_the_hand_is(frame):
    """The table states the position of the hand in mm from the camera."""
    done = run_tool("predict", *OWN, "frame.png", "--camera", "kinect2", *CENTER)
    first, *joints = done.out.splitlines()
    place = r"at -?\d+, -?\d+, \d{3} mm"
    assert re.fullmatch(f"frame.png: right hand; {place}, joints in mm from the camera, cube 300 mm; picture .*", first)
    assert len(joints) == 31 and all(abs(float(line.split()[-1]) - 700) < 300 for line in joints)


@pytest.mark.parametrize("name", ["mediapipe", "mano", "nyu"])
def test_joints_of_another_format(frame, name):
    """With --joints JSON has the other format in addition; the table shows its joints and angles instead."""
    count = {"mediapipe": 21, "mano": 21, "nyu": 14}[name]
    options = [*OWN, "frame.png", "--camera", "kinect2", *CENTER, "--out", "p", "--joints", name]
    lines = run_tool("predict", *options, "--json", "hands.json").out.splitlines()
    (found,) = hands_of(Path("hands.json").read_text())
    assert len(found["positions_mm"]) == 31 and len(found["anatomical_deg"]) == 20
    assert {len(values) for key, values in found[name].items() if key != "center_m"} == {count}
    if name == "nyu":
        assert found["nyu"]["positions_mm"][-1] == pytest.approx(found["joints"]["palm"], abs=0.02)
    assert len(lines) == 1 + 1 + count + 20 and lines[-1].split()[0] == "little_dip_flexion"


def test_another_format_of_a_crop(snapshot):
    """Landmarks are relative to the crop's image, metric joints to its centre."""
    (found,) = predicted("crop.png", "--joints", "mediapipe")
    x, y, _ = found["mediapipe"]["landmarks"][4]
    tip = found["joints"]["thumb_tip"]
    assert (x, y) == pytest.approx((0.5 + tip[0] / 300, 0.5 - tip[1] / 300), abs=1e-4)


def table(path):
    """Return the rows of a CSV file as dictionaries."""
    return list(csv.DictReader(Path(path).read_text(encoding="utf-8").splitlines()))


def test_a_table_of_frames(frame):
    """--csv writes a row per image with camera coordinates of the joints; without a fit there are no angles."""
    options = ["frame.png", "frame.png", "--camera", "kinect2", *CENTER, "--out", "p", "--json", "--csv", "hands.csv"]
    found = hands_of(run_tool("predict", *OWN, *options).out)
    rows = table("hands.csv")
    assert [(row["image"], row["hand"], row["confidence"], row["error_mm"]) for row in rows] == [
        ("frame.png", "right", "", "")
    ] * 2
    for row, values in zip(rows, found):
        joints = np.array([[float(row[f"{name}_{axis}_mm"]) for axis in "xyz"] for name in values["joints"]])
        assert joints == pytest.approx(np.array(values["positions_mm"]), abs=0.011)
    assert len(rows[0]) == 4 + 5 + 93


@pytest.mark.parametrize("name", ["mediapipe", "mano", "nyu"])
def test_a_table_of_another_format(snapshot, name):
    """For a crop the columns are those of a track, with joints relative to the crop's centre."""
    options = ["crop.png", "--out", "p", "--json", "--csv", "hands.csv", "--joints", name]
    (found,) = hands_of(run_tool("predict", *OWN, *options).out)
    [row] = table("hands.csv")
    fingers = [f"{finger}_error_mm" for finger in ("thumb", "index", "middle", "ring", "little")]
    assert list(row) == ["image", "hand", "confidence", "error_mm", *fingers, *joint_values.columns(name)]
    assert not any(row[finger] for finger in fingers)  # unknown in a crop without its frame
    numbers = [float(value) for value in list(row.values())[9:]]
    expected = [np.ravel(part) for part in found[name].values()] + [list(found["anatomical_deg"].values())]
    assert numbers == pytest.approx(np.concatenate(expected).tolist(), abs=1e-4)


def test_a_camera_by_its_numbers(frame):
    """A camera may be given by numbers; its size is that of the image."""
    assert predicted("frame.png", *CENTER, "--camera", "363.9,363.9,255.4,206.3") == predicted(
        "frame.png", *CENTER, "--camera", "kinect2"
    )


def test_the_unit_of_a_pixel(frame):
    """--unit sets the mm per unit of a pixel; the default for SR305 is 0.125."""
    cv2.imwrite("frame.png", frame * 4)
    (quarters,) = predicted("frame.png", *CENTER, "--camera", "kinect2", "--unit", "0.25")
    cv2.imwrite("frame.png", frame)
    assert [quarters] == predicted("frame.png", *CENTER, "--camera", "kinect2")
    cv2.imwrite("eighths.png", np.full((480, 640), 8000, np.uint16))
    assert (read_frame("eighths.png", CameraInfo(SR305)) == 1000).all()
    assert (read_frame("eighths.png", CameraInfo(SR305, unit_mm=0.1)) == 800).all()


def test_a_camera_by_its_file(snapshot):
    """A camera.json gives camera, unit and distortion; options on the command line take precedence."""
    slope = np.tile(np.arange(800, 800 + 512, dtype=np.uint16), (424, 1))  # where distortion changes the depth
    cv2.imwrite("frame.png", slope)
    beside = ["--center", "450,300"]
    four = '"fx": 363.9, "fy": 363.9, "u0": 255.4, "v0": 206.3'
    Path("own.json").write_text(f'{{{four}, "unit_mm": 0.25}}')
    cv2.imwrite("quarters.png", slope * 4)
    expected = predicted("frame.png", *beside, "--camera", "kinect2")[0]["positions_mm"]
    assert predicted("quarters.png", *beside, "--camera", "own.json")[0]["positions_mm"] == expected
    assert predicted("frame.png", *beside, "--camera", "own.json", "--unit", "1")[0]["positions_mm"] == expected
    Path("all.json").write_text(f'{{{four}, "distortion": [-0.1, 0.05, 0, 0]}}')
    bent = predicted("frame.png", *beside, "--camera", "all.json")[0]["positions_mm"]
    assert bent != expected
    options = [*beside, "--camera", "kinect2", "--distortion=-0.1,0.05,0,0"]
    assert predicted("frame.png", *options)[0]["positions_mm"] == bent


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"unit_mm": 1}', "own.json: has no camera; expected fx, fy, u0 and v0"),
        ('{"fx": 1', r"own.json:1:9: not JSON"),
        (None, "own.json: cannot read the camera: No such file or directory"),
        ('{"fx": 300, "fy": 300, "u0": 160, "v0": 120, "width": 320, "height": 240}',
         "frame.png: 512 x 424 pixels; camera own has 320 x 240"),
    ],
)
def test_a_camera_file_with_something_wrong(frame, text, message):
    """An invalid camera.json gives one line."""
    if text is not None:
        Path("own.json").write_text(text)
    assert re.match(message, mistake("frame.png", "--camera", "own.json"))


def test_a_frame_in_another_unit(frame):
    """If no hand is found, the error names the unit that may be wrong."""
    cv2.imwrite("fifths.png", frame * 5)
    assert re.search("the unit, 1 mm, may be wrong: .*--unit 0.2 ", mistake("fifths.png", "--camera", "kinect2"))


def test_centers(frame):
    """U,V,D is used unchanged; for U,V the depth is read from the image; each image may have its own centre."""
    v, u = (int(np.median(where)) for where in np.nonzero((frame > 0) & (frame < 800)))
    whole = ["--camera", "kinect2", "--refine", "0"]
    (found,) = predicted("frame.png", *whole, "--center", "250,200,690")
    assert found["center_uvd"] == [250, 200, 690]
    (found,) = predicted("frame.png", *whole, "--center", f"{u},{v}")
    assert found["center_uvd"] == pytest.approx(locator.depth_around(frame, u, v), abs=0.01)
    shutil.copy("frame.png", "again.png")
    centers = [[250, 200, 690], [260, 210, 700]]
    for given in (centers[:1], centers):
        options = [f"--center={u},{v},{d}" for u, v, d in given]
        both = predicted("frame.png", "again.png", *whole, *options)
        assert [found["center_uvd"] for found in both] == [given[0], given[-1]]


def test_the_hands_of_one_frame_have_pictures_of_their_own(frame):
    """A second hand in a frame gets a numbered picture; a conflicting file name is an error."""
    options = ["--camera", "kinect2", "--refine", "0", "--center=250,200,690", "--center=300,200,690"]
    found = predicted("frame.png", "frame.png", *options)
    assert [hand["picture"] for hand in found] == ["p/frame_hand.png", "p/frame_2_hand.png"]
    assert not np.array_equal(*(cv2.imread(hand["picture"]) for hand in found))
    shutil.copy("frame.png", "frame_2.png")
    error = mistake("frame.png", "frame.png", "frame_2.png", "--camera", "kinect2")
    assert error == "frame_2.png: its output frame_2_hand.png would overwrite another one; run once per folder"


@pytest.mark.parametrize(("times", "moved"), [("0", 0), ("1", 5), ("3", 15)])
def test_the_crop_is_moved_to_the_palm(frame, monkeypatch, times, moved):
    """The crop is moved to the predicted palm as often as --refine says."""
    monkeypatch.setattr(pipeline, "recenter", lambda joints, skeleton, center, *rest: center + (5, 0, 0))
    (found,) = predicted("frame.png", "--camera", "kinect2", "--center", "250,200,700", "--refine", times)
    assert found["center_uvd"] == [250 + moved, 200, 700]


@pytest.mark.parametrize("astray", [(0, 0, -600), (5000, 0, 0)])
def test_a_crop_is_not_moved_out_of_sight(frame, monkeypatch, astray):
    """The crop is not moved to the camera or outside the image."""
    monkeypatch.setattr(pipeline, "recenter", lambda joints, skeleton, center, *rest: center + astray)
    (found,) = predicted("frame.png", "--camera", "kinect2", "--center", "250,200,700")
    assert found["center_uvd"] == [250, 200, 700]


def test_nyus_colour_packing(snapshot):
    """Frames in NYU's colour encoding give the same result as gray ones."""
    depth = hand_before(NYU)
    cv2.imwrite("grey.png", depth)
    cv2.imwrite("packed.png", pack_depth(depth))
    grey, packed = predicted("grey.png", "packed.png", "--camera", "nyu", "--center", "345,257")
    assert grey["positions_mm"] == packed["positions_mm"] and grey["center_uvd"] == packed["center_uvd"]


def test_the_other_hand(snapshot):
    """--hand left gives exactly the mirror image of the prediction for the mirrored crop."""
    cv2.imwrite("mirrored.png", cv2.imread("crop.png", cv2.IMREAD_UNCHANGED)[:, ::-1])
    (left,) = predicted("crop.png", "--hand", "left")
    (right,) = predicted("mirrored.png")
    for name, (x, y, z) in right["joints"].items():
        assert left["joints"][name] == [-x, y, z]


def test_the_crop_of_the_other_hand_moves_the_other_way(frame, monkeypatch):
    """recenter receives the side of the hand."""
    sides = []
    monkeypatch.setattr(pipeline, "recenter", lambda *arguments: sides.append(arguments[-1]) or arguments[2])
    predicted("frame.png", "--camera", "kinect2", *CENTER, "--hand", "left", "--refine", "1")
    predicted("frame.png", "--camera", "kinect2", *CENTER, "--refine", "1")
    assert sides == ["left", "right"]


@pytest.mark.parametrize(
    ("image", "options", "message"),
    [
        (
            np.zeros((424, 512), np.uint16),
            [],
            "no depth anywhere in the image; give the position of the hand with --center U,V,D",
        ),
        (np.eye(424, 512, dtype=np.uint16) * 400, [], "nothing as large as a hand is seen nearer than 1600 mm; give"),
        (np.zeros((424, 512), np.uint16), ["--center", "9,9"], "no depth around pixel 9, 9; give"),
        (
            np.full((424, 512), 700, np.uint16),
            ["--center", "512,9"],
            "pixel 512, 9 lies outside the image of 512 x 424; give",
        ),
        (np.full((424, 512), 700, np.uint16), ["--center", "9,9,-1"], "crop 0: centre u 9 px, v 9 px, depth -1 mm"),
        (
            np.full((424, 512), 700, np.uint16),
            ["--center", "9,9999,700"],
            "the cube of 300 mm at u 9, v 9999, 700 mm lies",
        ),
        (np.ones((480, 640), np.uint16), [], "640 x 480 pixels; camera kinect2 has 512 x 424"),
        (np.ones((424, 512), np.uint8), [], r"found uint8 \(424, 512\); expected a 16-bit grey PNG of depth"),
        (np.ones((424, 512, 3), np.uint8), [], r"found uint8 \(424, 512, 3\); expected a 16-bit grey PNG of depth"),
        (np.full((424, 512), 700, np.uint16), ["--unit", "1000"], "depths from 700000 to 700000, expected mm, nearer"),
        (
            np.full((424, 512), 700, np.uint16),
            ["--unit", ".001"],
            "depths from 0.7 to 0.7, expected mm; they may be met",
        ),
        (None, [], "not an image that OpenCV can decode"),
    ],
    ids=[
        "empty",
        "little",
        "hole",
        "beside",
        "behind",
        "far off",
        "size",
        "8-bit",
        "colour",
        "far unit",
        "near unit",
        "no picture",
    ],
)
def test_frames_with_something_wrong(snapshot, image, options, message):
    """An invalid frame gives one line with its name."""
    if image is None:
        np.zeros(3).tofile("bad.png")
    else:
        cv2.imwrite("bad.png", image)
    assert re.match(f"bad.png: {message}", mistake("bad.png", "--camera", "kinect2", *options))


def test_a_camera_that_is_likely_wrong(frame):
    """An implausible camera gives one warning; a correct one gives none."""
    for camera, count in (("kinect2", 0), ("5,5,255.4,206.3", 1)):
        argv = [*OWN, "--out", "p", "frame.png", "--camera", camera, "--center", "260,210,700"]
        lines = run_tool("predict", *argv).err.splitlines()
        assert len(lines) >= count and all(line.startswith("warning: frame.png: ") for line in lines)
        assert sum("check fx and fy" in line for line in lines) == count


def test_a_frame_without_its_camera(frame):
    """A full frame without --camera gives an error that names the option."""
    assert mistake("frame.png").endswith("(for a whole depth frame name its --camera)")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--camera", "kinect3"], "expected a file, nyu, icvl, msra15, kinect2, sr305, d405, "),
        (["--camera", "1,2,3"], "or FX,FY,U0,V0 in px, the intrinsics from its SDK, found '1,2,3'"),
        (["--camera", "0,1,2,3"], "or FX,FY,U0,V0 in px, the intrinsics from its SDK, found '0,1,2,3'"),
        (["--center", "1,2"], "--center applies only to full frames, with --camera"),
        (["--unit", "1"], "--unit applies only to full frames, with --camera"),
        (["--distortion", "0,0,0,0"], "--distortion applies only to full frames, with --camera"),
        (["--refine", "2"], "--refine applies only to full frames, with --camera"),
        (["--camera", "nyu", "--center", "1"], "expected U,V or U,V,D (px, px, mm), found '1'"),
        (["--camera", "nyu", "--center", "1,nan"], "expected U,V or U,V,D (px, px, mm), found '1,nan'"),
        (
            ["--camera", "nyu", *["--center", "1,2"] * 3],
            "--center is given 3 times for 2 images; expected once, or once per image",
        ),
        (
            ["--camera", "nyu", "--unit", "0"],
            "argument --unit: expected a number greater than 1e-06 and at most 10000, found '0'",
        ),
        (["--camera", "nyu", "--refine", "-1"], "expected an integer of at least 0, found '-1'"),
        (["--refine", "101"], "expected an integer of at most 100, found '101'"),
        (["--cube", "0.3"], "argument --cube: expected a number of at least 50 and at most 10000 mm, found '0.3'"),
        (["--hand", "either"], "--hand either needs a fit; use --hand right or left"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_usage(options, message):
    """Wrong usage gives argparse's message and status 2."""
    assert message in run_tool("predict", *OWN, "a.png", "b.png", *options, status=2).err


def test_a_net_without_its_weights():
    """--model without --weights is rejected, as the packaged weights do not apply."""
    done = run_tool("predict", "a.png", "--model", "net.prototxt", status=2)
    assert "--model needs --weights" in done.err


# ------------------------------------------------------------------------------------- a page for the browser


def hands_in(page):
    """Return the hands of a page, each with the joints (K, 3) in mm computed from its inputs."""
    text = Path(page).read_text(encoding="utf-8")
    data = json.loads(re.search(r'id="data">(.*?)</script>', text)[1])
    hands, (shown,) = data["hands"], data["bodies"]
    skeleton = skeletons.load(skeletons.NYU_HAND.with_name(f"{shown['name']}.prototxt"))
    assert shown["skeleton"] == skeleton_values(skeleton)
    for hand in hands:
        inputs = np.array([hand["inputs"][: len(skeleton.dof_names)]])
        joints = Kinematics(skeleton).joints(inputs, skeleton.bones[None] * hand["size"])[0]
        hand["joints"] = joints * hand["place"]["unit_mm"] * (-1 if hand["side"] == "left" else 1, 1, 1)
    return hands


def test_a_page_of_crops(snapshot):
    """The page has all images, and its inputs give the printed joints for either hand and any cube."""
    cv2.imwrite("b.png", np.random.default_rng(1).integers(0, 256, (128, 128), dtype=np.uint8))
    for side, cube in (("right", 300), ("left", 250)):
        printed = predicted("crop.png", "b.png", "--html", "page.html", "--hand", side, "--cube", str(cube))
        shown = hands_in("page.html")
        assert [hand["name"] for hand in shown] == ["crop.png", "b.png"]
        for found, hand in zip(printed, shown):
            assert (hand["side"], hand["place"]["cube_mm"], hand["words"]) == (side, cube, f"{side} hand")
            np.testing.assert_allclose(hand["joints"], found["positions_mm"], atol=0.02)


def test_a_page_of_a_frame(frame):
    """The page has the camera, the centre of the crop, and the depth points around it."""
    whole = ["--camera", "363.9,363.9,255.4,206.3", "--center", "250,200,700", "--html", "page.html"]
    (found,) = predicted("frame.png", *whole)
    (hand,) = hands_in("page.html")
    assert hand["place"]["center_uvd"] == pytest.approx(found["center_uvd"], abs=0.01)
    camera = Camera(**hand["place"]["camera"])
    assert (camera.width, camera.height, camera.fx) == (512, 424, 363.9)
    points = np.frombuffer(base64.b64decode(hand["points"]), "<i2").reshape(-1, 3) * hand["step_mm"]
    u, v, d = camera.project(points + camera.unproject(hand["place"]["center_uvd"])).T
    assert len(points) > 1000
    np.testing.assert_allclose(d, frame[np.rint(v).astype(int), np.rint(u).astype(int)], atol=0.1)


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("net.caffemodel.h5", "net.caffemodel.h5: is read in this run; expected another output"),
        ("crop.png", "crop.png: is read in this run; expected another output"),
        ("gone/page.html", "gone/page.html: folder gone does not exist"),
        (".", ".: Is a directory"),
    ],
)
def test_a_page_that_cannot_be_written(snapshot, place, message):
    """A page that cannot be written is reported on one line before any prediction."""
    assert mistake("crop.png", "--html", place) == message
    assert not Path("p").exists() or not list(Path("p").iterdir())


# ------------------------------------------------------------------------------------- the packaged weights


def test_a_hand_below_the_minimum_confidence(frame):
    """The line, the table, JSON and CSV have its confidence and place, and no joints; there is nothing for a page."""
    options = ["frame.png", *CENTER, "--camera", "kinect2", "--fit", "fast", "--hand", "right", "--out", "p"]
    (hand,) = hands_of(run_tool("predict", *options, "--min-confidence", "0", "--json").out)
    assert hand["confidence"] < 1
    options += ["--min-confidence", "1"]
    for joints in ([], ["--joints", "mano"]):
        (line,) = run_tool("predict", *options, *joints).out.splitlines()
        assert f"{percent(hand['confidence'])} sure" in line and "no joints below 100% (--min-confidence), cube" in line
        for name in ("x.json", "x.csv", "x.html"):
            Path(name).unlink(missing_ok=True)
        outputs = ["--json", "x.json", "--csv", "x.csv", "--html", "x.html"]
        done = run_tool("predict", *options, *joints, *outputs, status=1)
        assert "x.html: not written: nothing has joints, which need a confidence of at least 100%" in done.err
        document = json.loads(Path("x.json").read_text())
        assert not json_schema.faults(document)
        [found] = document["frames"]
        assert found["hands"] == [] and [place["position_mm"] for place in found["refused"]] == [
            pytest.approx(hand["origin_mm"], abs=0.06)]
        assert found["refused"][0]["reason"] == f"the pose is uncertain (confidence {hand['confidence']:.0%})"
        (row,) = table("x.csv")
        assert float(row["confidence"]) == pytest.approx(hand["confidence"], abs=1e-4) and row["hand"] == "right"
        about = ("image", "hand", "confidence", "error_mm", *(f"{finger}_error_mm" for finger in FINGERS))
        assert len(row) > 60 and not any(value for key, value in row.items() if key not in about)
    assert cv2.imread(found["picture"]).shape[1] < 2 * 512  # the crop alone
    assert read_track("x.json").frames[0].refused[0].reason == found["refused"][0]["reason"]


def test_a_hand_with_the_packaged_weights(tmp_path, monkeypatch):
    """A fitted hand has the correct side, an expected error, and 14 joints within 2 cm of the truth on average."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    sampler = BodySampler(prior_file.load(prior_file.PEOPLE_PRIOR))
    hand = sampler.draw(rng, 1)
    depth = render_image(capsules_of(sampler, rng, hand, (30, -20, 700), ARM_BEHIND), KINECT2)[0]
    cv2.imwrite("frame.png", np.where(np.isfinite(depth), depth, 0).astype(np.uint16))
    cv2.imwrite("mirrored.png", np.where(np.isfinite(depth), depth, 0).astype(np.uint16)[:, ::-1])
    at, mirrored = ([f"--center={u},{v},700"] for u, v in ((271, 217), (240, 217)))
    arguments = [
        "frame.png",
        *at,
        "--camera",
        "kinect2",
        "--out",
        "p",
        "--html",
        "page.html",
        "--csv",
        "hand.csv",
        "--json",
    ]
    (found,) = hands_of(text := run_tool("predict", *arguments).out)
    assert found["hand"] == "right" and found["error_mm"] < 15 and found["confidence"] > 0.9
    joints = np.array(found["positions_mm"])
    truth = hand.joints[0] * 150 + (30, -20, 700)
    assert np.linalg.norm(joints - truth, axis=1)[list(EVALUATION_JOINTS)].mean() < 20
    (row,) = table("hand.csv")
    assert float(row["error_mm"]) == pytest.approx(found["error_mm"], abs=0.0051)
    for finger, error in found["finger_error_mm"].items():
        assert 0 < error < 30 and float(row[f"{finger}_error_mm"]) == pytest.approx(error, abs=0.051)
    assert len(row) == 4 + 5 + 93 + 23 and all(row.values())
    (shown,) = hands_in("page.html")
    np.testing.assert_allclose(shown["joints"] + found["origin_mm"], joints, atol=0.02)
    Path("track.json").write_text(text)
    (header, ((_, _, (hand,), *_),), _) = read_track("track.json")
    np.testing.assert_allclose(shown["inputs"][:47], hand.inputs, atol=1e-5)
    again = joints_of(header.skeleton, header.unit_mm, hand.hand, hand.inputs, hand.bones, hand.origin_mm)
    np.testing.assert_allclose(again, joints, atol=0.02)
    assert len(shown["inputs"]) == 52 and np.any(shown["inputs"][47:]) and shown["thickness"] != 1
    picture = cv2.imread("p/frame_hand.png")
    assert picture.shape[1] > 3 * 512  # skeleton, surface, side view
    (other,) = hands_of(run_tool("predict", "mirrored.png", *mirrored, *arguments[2:]).out)
    assert other["hand"] == "left" and other["angles_rad"].keys() == found["angles_rad"].keys()
    first = run_tool("predict", *arguments[:-1], "--fit", "fast", "--hand", "right").out.splitlines()[0]
    assert re.match(r"frame.png: right hand, (>99|\d+)% sure, \d+ mm of error expected; at -?\d+, ", first)
