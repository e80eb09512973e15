"""tools/predict.py: joints and a picture for each crop."""

import json

import cv2
import h5py
import numpy as np
import pytest

import netlib
from tests.tools.conftest import ROOT
from tools import predict


@pytest.fixture
def snapshot(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    netlib.Net(ROOT / "prototxt" / "nyu_deploy.prototxt", netlib.TEST, seed=1).save("net.caffemodel.h5")
    rng = np.random.default_rng(0)
    cv2.imwrite("crop.png", rng.integers(0, 256, (128, 128), dtype=np.uint8))
    return "net.caffemodel.h5"


def test_joints_and_picture(snapshot, capsys):
    """JSON has 31 joints in mm, scaled by the cube; the picture is written beside."""
    assert predict.main([snapshot, "crop.png", "--out", "p", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)[0]
    assert cv2.imread(found["picture"]) is not None and found["picture"] == "p/crop_hand.png"
    assert len(found["joints_mm"]) == 31
    assert predict.main([snapshot, "crop.png", "--out", "p", "--json", "--cube", "261"]) == 0
    smaller = json.loads(capsys.readouterr().out)[0]
    assert smaller["joints_mm"]["palm"] == pytest.approx(np.array(found["joints_mm"]["palm"]) * 0.87, abs=0.02)


def test_crop_is_normalised(snapshot):
    """Grey 0 is the near plane -1, 255 the far plane 1; other sizes are resized by nearest neighbour."""
    cv2.imwrite("two.png", np.kron(np.array([[0, 255]] * 2, np.uint8), np.ones((32, 32), np.uint8)))
    crop = predict.read_crop("two.png")
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
def test_mistakes(snapshot, capsys, image, message):
    """A picture that is not a crop is one line."""
    if image is not None:
        cv2.imwrite("bad.png", image)
    assert predict.main([snapshot, "bad.png"]) == 1
    assert message in capsys.readouterr().err


def test_no_picture_is_written_over(snapshot, tmp_path, capsys):
    """Two crops of one name, or a crop that has the name of a picture to be."""
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        cv2.imwrite(f"{folder}/x.png", np.zeros((128, 128), np.uint8))
    cv2.imwrite("x_hand.png", np.zeros((128, 128), np.uint8))
    before = (tmp_path / "x_hand.png").read_bytes()
    assert predict.main([snapshot, "a/x.png", "b/x.png", "--out", "o"]) == 1
    assert "b/x.png: its picture o/x_hand.png would overwrite another's" in capsys.readouterr().err
    assert predict.main([snapshot, "a/x.png", "x_hand.png"]) == 1
    assert "a/x.png: its picture x_hand.png would overwrite an input" in capsys.readouterr().err
    assert (tmp_path / "x_hand.png").read_bytes() == before


def test_weights_that_lack_a_layer(snapshot, capsys):
    """A hand from half the weights would look like an answer."""
    with h5py.File(snapshot, "a") as file:
        del file["data/FC2"]
    assert predict.main([snapshot, "crop.png"]) == 1
    assert "no weights for layer 'FC2' of net 'DeepModel'" in capsys.readouterr().err
