"""tools/run_net.py: a net on images, its best classes, and its blobs in files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import netlib
from netlib.blob import Array
from tests.support.caffe_messages import write_blob
from tests.support.nets import inputs, ip
from tests.support.running import Done, refusal, run_tool
from tests.tools.conftest import mistakes_of

POOLING = (
    inputs(data=(2, 3, 8, 10))
    + 'layer { name: "pool" type: "Pooling" bottom: "data" top: "pool" pooling_param { pool: AVE kernel_size: 2 } }'
)
NET = (
    POOLING
    + ip("fc/1", "pool", "fc/1", outputs=4)
    + 'layer { name: "prob" type: "Softmax" bottom: "fc/1" top: "prob" }'
)
IMAGE_SHAPES = ((8, 10), (20, 12), (9, 30))  # (H, W)


@pytest.fixture(autouse=True)
def work(here: Path) -> None:
    """A folder with net.prototxt, its weights, 0.png to 2.png, and labels.txt for four classes."""
    Path("net.prototxt").write_text(NET)
    net = netlib.Net("net.prototxt", netlib.TEST, seed=1)
    net.params["fc/1"][0].data[...] /= 50
    net.save("net.caffemodel")
    for number, shape in enumerate(IMAGE_SHAPES):
        rng = np.random.default_rng(number)
        cv2.imwrite(f"{number}.png", rng.integers(0, 256, (*shape, 3), np.uint8))
    Path("labels.txt").write_text("n01 cat, tabby\nn02 dog\nn03 bird\nn04 fish\n")


def images() -> list[Array]:
    """The three images (H, W, 3)."""
    return [cv2.imread(f"{number}.png") for number in range(3)]


def run(options: str, status: int = 0) -> Done:
    return run_tool(f"run_net net.prototxt net.caffemodel {options}", status=status)


def blob_of(data: Array, name: str = "prob") -> Array:
    """A blob of the net for an input (N, 3, 8, 10)."""
    net = netlib.Net("net.prototxt", "net.caffemodel", netlib.TEST)
    return net.forward([name], data=data)[name]


def test_the_best_classes_are_printed() -> None:
    printed = run("0.png 1.png 2.png --mean 104,117,123 --labels labels.txt --top 2").out
    prob = blob_of(cv2.dnn.blobFromImages(images(), 1, (10, 8), (104, 117, 123)))
    labels = Path("labels.txt").read_text().splitlines()
    expected = []
    for number, scores in enumerate(prob):
        expected.append(f"{number}.png: prob")
        for label in np.argsort(-scores)[:2]:
            expected.append(f"  {scores[label]:.4f}  {labels[label]}")
    assert printed.splitlines() == expected


def test_blobs_are_written_to_files() -> None:
    """A .npz file has the named blobs of all images, whatever their names; a .npy file has one."""
    assert run("0.png 1.png 2.png --blob fc/1 --blob pool --out a.npz").out == (
        "wrote a.npz: fc/1 (3, 4), pool (3, 3, 7, 9)\n"
    )
    data = cv2.dnn.blobFromImages(images(), 1, (10, 8))
    with np.load("a.npz") as file:
        assert sorted(file) == ["fc/1", "pool"]
        assert np.allclose(file["fc/1"], blob_of(data, "fc/1"), rtol=1e-5)
        assert np.array_equal(file["pool"], blob_of(data, "pool"))
    lines = run("0.png 1.png --out b.npy --labels labels.txt").out.splitlines()
    assert lines[0] == "0.png: prob"
    assert lines[-1] == "wrote b.npy: prob (2, 4)"
    assert np.load("b.npy").shape == (2, 4)


@pytest.mark.parametrize(
    ("options", "arguments"),
    [
        ("--scale 0.017 --mean 104,117,123 --rgb", (0.017, (10, 8), (104, 117, 123), True)),
        ("--crop --mean 7", (1.0, (10, 8), (7, 7, 7), False, True)),
        ("--size 10x8 --resize 10x8", (1.0, (10, 8))),
        ("--mean-file mean.npy", (1.0, (10, 8), (1, 2, 3))),
    ],
)
def test_preprocessing_equals_that_of_opencv(options: str, arguments: tuple[object, ...]) -> None:
    """The options are the arguments of cv2.dnn.blobFromImage; a mean file may have a
    number per channel.
    """
    np.save("mean.npy", np.array([1, 2, 3]))
    run(f"0.png 1.png 2.png {options} --blob data --out data.npy")
    assert np.array_equal(np.load("data.npy"), cv2.dnn.blobFromImages(images(), *arguments))


def test_the_size_and_the_batch_are_options() -> None:
    """--size reshapes a net without fully connected layers, and --batch sets the number of
    images of a pass.
    """
    Path("net.prototxt").write_text(POOLING)
    run("0.png 1.png 2.png --size 30x20 --batch 3 --blob pool --out pool.npy")
    assert np.load("pool.npy").shape == (3, 3, 19, 29)


def test_the_pictures_of_a_folder_are_sorted_by_number() -> None:
    """Other files and hidden ones are left out."""
    Path("some").mkdir()
    for name, source in (("b 10.png", "0.png"), ("b 9.PNG", "1.png"), (".hidden.png", "2.png")):
        Path("some", name).write_bytes(Path(source).read_bytes())
    Path("some", "Thumbs.db").write_text("")
    titles = run("some 2.png --top 1").out.splitlines()[::2]
    assert titles == ["some/b 9.PNG: prob", "some/b 10.png: prob", "2.png: prob"]
    run("some --out of_folder.npy")
    run("1.png 0.png --out of_files.npy")
    assert np.array_equal(np.load("of_folder.npy"), np.load("of_files.npy"))


def test_a_folder_without_pictures_is_rejected() -> None:
    Path("empty").mkdir()
    line = refusal("run_net net.prototxt net.caffemodel empty")
    assert line.startswith("empty: no picture in this folder (.bmp, .jpeg")
    assert line.endswith(".webp)")
    Path("empty/cats").mkdir()
    line = refusal("run_net net.prototxt net.caffemodel empty")
    assert line.endswith("; give the folders in it, such as empty/cats")


def test_the_root_folder_is_prepended_to_the_paths_of_a_list() -> None:
    """test_finetune.py compares the input with that of an ImageData layer."""
    Path("list.txt").write_text("0.png 7\n")
    run("list.txt --root-folder pictures/ --out missing.npy", status=1)
    Path("pictures").mkdir()
    Path("0.png").rename("pictures/0.png")
    run("list.txt --root-folder pictures/ --out prob.npy")


@pytest.mark.parametrize("name", ["mean.binaryproto", "mean.npy"])
def test_a_mean_image_is_subtracted_before_the_crop(name: str) -> None:
    """Images are resized to the mean image's size; the input is the centre of the difference."""
    mean = np.random.default_rng(3).uniform(90, 130, (1, 3, 13, 12)).astype(np.float32)
    if name.endswith(".npy"):
        np.save(name, mean[0].astype(np.float64))
    else:
        write_blob(Path(name), mean)
    run(f"0.png 1.png --mean-file {name} --scale 0.5 --blob data --out data.npy")
    resized = np.stack([cv2.resize(image, (12, 13)) for image in images()[:2]])
    centred = resized.transpose(0, 3, 1, 2) - mean
    crop = centred[:, :, 2:10, 1:11]
    assert np.array_equal(np.load("data.npy"), crop * np.float32(0.5))


def test_a_net_with_one_channel_reads_grey_images() -> None:
    Path("net.prototxt").write_text(
        inputs(data=(1, 1, 8, 10)) + 'layer { name: "p" type: "Power" bottom: "data" top: "y" }'
    )
    run("0.png --out y.npy")
    assert np.array_equal(np.load("y.npy")[0, 0], cv2.imread("0.png", cv2.IMREAD_GRAYSCALE))


DETECTOR = (
    inputs(data=(1, 3, 8, 10))
    + ip("loc", "data", "loc", outputs=4)
    + ip("conf", "data", "conf", outputs=3)
    + """
layer { name: "map" type: "Pooling" bottom: "data" top: "map" pooling_param { pool: AVE global_pooling: true } }
layer { name: "prior" type: "PriorBox" bottom: "map" bottom: "data" top: "prior" prior_box_param { min_size: 4 } }
layer { name: "found" type: "DetectionOutput" bottom: "loc" bottom: "conf" bottom: "prior" top: "found"
        detection_output_param { num_classes: 3 code_type: CENTER_SIZE confidence_threshold: 0.2 } }
"""
)


@pytest.fixture
def detector() -> None:
    """A net that finds one box of 4 x 4 px of its input of 10 x 8 in the centre of every image, as
    classes 1 and 2.
    """
    Path("net.prototxt").write_text(DETECTOR)
    net = netlib.Net("net.prototxt", netlib.TEST)
    for name, bias in (("loc", [0, 0, 0, 0]), ("conf", [0.9, 0.3, 0.8])):
        net.params[name][0].data.fill(0)
        net.params[name][1].data[...] = bias
    net.save("net.caffemodel")


@pytest.mark.usefixtures("detector")
def test_detections_of_two_classes_are_printed() -> None:
    Path("labels.txt").write_text("background\ncat\ndog\n")
    assert run("1.png --labels labels.txt").out.splitlines() == [
        "1.png: found: 2 detections",
        "  0.8000  dog  4 5 8 15",
        "  0.3000  cat  4 5 8 15",
    ]


@pytest.mark.usefixtures("detector")
@pytest.mark.parametrize(
    ("options", "box"),
    [
        ("1.png", "4 5 8 15"),
        ("2.png --crop", "13 2 17 7"),
        # of 30 x 9 px resized to 20 x 16: the input is (5, 4) to (15, 12) of it, the box
        # (8, 6) to (12, 10)
        ("2.png --resize 20x16", "12 3 18 6"),
    ],
)
def test_boxes_are_in_px_of_the_image(options: str, box: str) -> None:
    """Whichever way the image is resized."""
    assert run(f"{options} --top 1").out.splitlines()[1:] == [f"  0.8000  class 2  {box}"]


@pytest.mark.usefixtures("detector")
@pytest.mark.parametrize(
    ("argv", "message"),
    [
        ("0.png 1.png --draw a.png", "a.png: one file for 2 images; expected a folder"),
        ("0.png --draw 0.png", "0.png: is read in this run"),
        (
            "0.png --labels twice.prototxt",
            "twice.prototxt:1:25: the label 0; expected each from 0 to 65535 once",
        ),
        (
            "0.png --labels few.txt",
            "few.txt: 2 labels, but blob 'found' has 3 classes, the background included",
        ),
    ],
)
def test_invalid_outputs_and_label_maps_are_rejected(argv: str, message: str) -> None:
    Path("few.txt").write_text("cat\ndog\n")
    Path("twice.prototxt").write_text('item { name: "a" } item { name: "b" }')
    assert message in run(argv, status=1).err


def test_the_first_value_that_is_not_finite_is_located(caplog: pytest.LogCaptureFixture) -> None:
    """The warning names its blob or parameter."""
    net = netlib.Net("net.prototxt", "net.caffemodel", netlib.TEST)
    net.params["fc/1"][1].data[0] = np.nan
    net.save("net.caffemodel")
    assert "nan  class 0" in run("0.png 1.png --batch 1").out
    assert caplog.messages == [
        "NaN or infinity, first in parameter 1 of layer 'fc/1': check the weights, the mean and "
        "the scale"
    ]


SILENCE = 'layer { name: "s" type: "Silence" bottom: "a" }'
TRAIN = (
    'layer { name: "d" type: "DummyData" top: "data" dummy_data_param { shape { dim: 1 dim: 3 } } }'
)


@mistakes_of("run_net")
def test_mistakes(argv: str, message: str) -> None:
    """Each mistake is one line with the file or the option, and nothing is written."""
    Path("empty.txt").write_text("")
    Path("labels.npy").write_text("cat\n")
    Path("list.txt").write_text("0.png 9\n")
    Path("three.txt").write_text("a\nb\nc\n")
    Path("nul.txt").write_bytes(b"a\0b.png 0\n")
    np.save("bad.npy", np.zeros((2, 2)))
    np.save("mean.npy", np.zeros((3, 13, 15)))
    np.save("nan.npy", np.full(3, np.nan))
    assert message in refusal(f"run_net net.prototxt net.caffemodel {argv}")


@pytest.mark.parametrize(
    ("net", "message"),
    [
        (TRAIN, ":1:19: this is a training net: layer 'd' of type DummyData reads the data"),
        (
            inputs(a=(1, 3, 2, 2)) + SILENCE,
            ": no layer leaves a blob unread, so the net has no output; name one with --blob",
        ),
        (inputs(a=(1, 3, 2, 2), b=(1, 3)), ": the net has the inputs a, b; expected one"),
        (inputs(a=(1, 7)), ": the input 'a' has shape (1, 7); expected (N, C, H, W)"),
    ],
)
def test_unsuitable_nets_are_rejected(net: str, message: str) -> None:
    Path("net.prototxt").write_text(net)
    line = refusal("run_net net.prototxt net.caffemodel 0.png")
    assert line.startswith(f"net.prototxt{message}")


LABEL_MAP = """# names
item { name: "none_of_the_above" label: 0 display_name: "background" }
item { name: "n2" label: 2 }
"""


@pytest.mark.usefixtures("detector")
def test_detections_below_the_threshold_are_left_out() -> None:
    """The names of the others are those of a label map."""
    Path("map.prototxt").write_text(LABEL_MAP)
    lines = run("1.png --labels map.prototxt --threshold 0.5").out.splitlines()
    assert lines == ["1.png: found: 2 detections", "  0.8000  n2  4 5 8 15"]
    assert len(run("1.png --threshold 0.9").out.splitlines()) == 1


@pytest.mark.usefixtures("detector")
def test_boxes_are_drawn_into_a_picture_or_a_folder_of_pictures() -> None:
    run("1.png --threshold 0.5 --draw found.png")
    picture, image = cv2.imread("found.png"), cv2.imread("1.png")
    assert picture.shape == image.shape
    lower_edge = (15, slice(4, 8))
    assert (picture[lower_edge] != image[lower_edge]).any(axis=1).all()
    run("0.png 2.png --draw pictures")
    for number in (0, 2):
        assert cv2.imread(f"pictures/{number}.jpg").shape == (*IMAGE_SHAPES[number], 3)
