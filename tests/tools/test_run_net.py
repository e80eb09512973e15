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

NET = (
    inputs(data=(2, 3, 8, 10))
    + 'layer { name: "pool" type: "Pooling" bottom: "data" top: "pool" pooling_param { pool: AVE kernel_size: 2 } }'
    + ip("fc/1", "pool", "fc/1", outputs=4)
    + 'layer { name: "prob" type: "Softmax" bottom: "fc/1" top: "prob" }'
)
SHAPES = ((8, 10), (20, 12), (9, 30))  # (H, W) of the images


@pytest.fixture(autouse=True)
def work(here: Path) -> None:
    """A folder with net.prototxt, its weights, 0.png to 2.png, and labels.txt for four classes."""
    Path("net.prototxt").write_text(NET)
    net = netlib.Net("net.prototxt", netlib.TEST, seed=1)
    net.params["fc/1"][0].data[...] /= 50
    net.save("net.caffemodel")
    for number, shape in enumerate(SHAPES):
        cv2.imwrite(
            f"{number}.png", np.random.default_rng(number).integers(0, 256, (*shape, 3), np.uint8)
        )
    Path("labels.txt").write_text("n01 cat, tabby\nn02 dog\nn03 bird\nn04 fish\n")


def images() -> list[Array]:
    return [cv2.imread(f"{number}.png") for number in range(3)]


def run(options: str, status: int = 0) -> Done:
    return run_tool(f"run_net net.prototxt net.caffemodel {options}", status=status)


def outputs_of(blob: Array, name: str = "prob") -> Array:
    return netlib.Net("net.prototxt", "net.caffemodel", netlib.TEST).forward([name], data=blob)[
        name
    ]


def test_best_classes() -> None:
    lines = run("0.png 1.png 2.png --mean 104,117,123 --labels labels.txt --top 2").out
    prob = outputs_of(cv2.dnn.blobFromImages(images(), 1, (10, 8), (104, 117, 123)))
    labels = Path("labels.txt").read_text().splitlines()
    expected = []
    for number in range(3):
        best = np.argsort(-prob[number])[:2]
        expected += [
            f"{number}.png: prob",
            *(f"  {prob[number, i]:.4f}  {labels[i]}" for i in best),
        ]
    assert lines.splitlines() == expected


def test_blobs_in_files() -> None:
    """A .npz file has the named blobs of all images, whatever their names; a .npy file has one."""
    assert run("0.png 1.png 2.png --blob fc/1 --blob pool --out a.npz").out == (
        "wrote a.npz: fc/1 (3, 4), pool (3, 3, 7, 9)\n"
    )
    blob = cv2.dnn.blobFromImages(images(), 1, (10, 8))
    with np.load("a.npz") as file:
        assert sorted(file) == ["fc/1", "pool"]
        assert np.allclose(file["fc/1"], outputs_of(blob, "fc/1"), rtol=1e-5)
        assert np.array_equal(file["pool"], outputs_of(blob, "pool"))
    printed = run("0.png 1.png --out b.npy --labels labels.txt").out.splitlines()
    assert printed[0] == "0.png: prob" and printed[-1] == "wrote b.npy: prob (2, 4)"
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
def test_preprocessing_as_in_opencv(options: str, arguments: tuple[object, ...]) -> None:
    """The options are the arguments of cv2.dnn.blobFromImage; a mean file may have a
    number per channel.
    """
    np.save("mean.npy", np.array([1, 2, 3]))
    run(f"0.png 1.png 2.png {options} --blob data --out data.npy")
    assert np.array_equal(np.load("data.npy"), cv2.dnn.blobFromImages(images(), *arguments))


def test_another_size() -> None:
    """--size reshapes a net without fully connected layers, and --batch sets the number of
    images of a pass.
    """
    Path("net.prototxt").write_text(NET[: NET.index("layer", NET.index("pool"))])
    run("0.png 1.png 2.png --size 30x20 --batch 3 --blob pool --out pool.npy")
    assert np.load("pool.npy").shape == (3, 3, 19, 29)


def test_a_folder_of_pictures() -> None:
    """Pictures are in the order of their numbers; other files and hidden ones are left out."""
    Path("some").mkdir()
    for name, source in (("b 10.png", "0.png"), ("b 9.PNG", "1.png"), (".hidden.png", "2.png")):
        Path("some", name).write_bytes(Path(source).read_bytes())
    Path("some", "Thumbs.db").write_text("")
    lines = run("some 2.png --top 1").out.splitlines()[::2]
    assert lines == ["some/b 9.PNG: prob", "some/b 10.png: prob", "2.png: prob"]
    run("some --out of_folder.npy")
    run("1.png 0.png --out of_files.npy")
    assert np.array_equal(np.load("of_folder.npy"), np.load("of_files.npy"))
    Path("empty").mkdir()
    line = refusal("run_net net.prototxt net.caffemodel empty")
    assert line.startswith("empty: no picture in this folder (.bmp, .jpeg")


def test_a_list_of_images_in_a_folder() -> None:
    """--root-folder is prepended to each path; test_finetune.py compares the input with that of an
    ImageData layer.
    """
    Path("list.txt").write_text("0.png 7\n")
    run("list.txt --root-folder pictures/ --out missing.npy", status=1)
    Path("pictures").mkdir()
    Path("0.png").rename("pictures/0.png")
    run("list.txt --root-folder pictures/ --out prob.npy")


@pytest.mark.parametrize("name", ["mean.binaryproto", "mean.npy"])
def test_mean_image(name: str) -> None:
    """With a mean image, images are resized to its size, it is subtracted, and the input is cut
    from the centre.
    """
    mean = np.random.default_rng(3).uniform(90, 130, (1, 3, 13, 12)).astype(np.float32)
    if name.endswith(".npy"):
        np.save(name, mean[0].astype(np.float64))
    else:
        write_blob(Path(name), mean)
    run(f"0.png 1.png --mean-file {name} --scale 0.5 --blob data --out data.npy")
    resized = np.stack([cv2.resize(image, (12, 13)) for image in images()[:2]])
    resized = resized.transpose(0, 3, 1, 2)
    middle = (resized - mean)[:, :, 2:10, 1:11]
    assert np.array_equal(np.load("data.npy"), middle * np.float32(0.5))


def test_grey_net() -> None:
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
def test_detections() -> None:
    """The best detections are printed with their boxes in px of the image, in each
    way to resize it.
    """
    Path("labels.txt").write_text("background\ncat\ndog\n")
    stretched = "  0.8000  dog  4 5 8 15", "  0.3000  cat  4 5 8 15"
    assert run("1.png --labels labels.txt").out.splitlines() == [
        "1.png: found: 2 detections",
        *stretched,
    ]
    assert run("1.png --top 1").out.splitlines()[1:] == ["  0.8000  class 2  4 5 8 15"]
    assert run("2.png --top 1 --crop").out.splitlines()[1:] == ["  0.8000  class 2  13 2 17 7"]
    # of 30 x 9 px resized to 20 x 16: the input is (5, 4) to (15, 12) of it, the box
    # (8, 6) to (12, 10)
    assert run("2.png --top 1 --resize 20x16").out.splitlines()[1:] == [
        "  0.8000  class 2  12 3 18 6"
    ]


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
    """One line names its blob or parameter."""
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
def test_the_surest_detections_in_pictures() -> None:
    """--threshold, names of a label map, and a picture of each image."""
    Path("map.prototxt").write_text(LABEL_MAP)
    done = run("1.png --labels map.prototxt --threshold 0.5 --draw found.png")
    assert done.out.splitlines() == ["1.png: found: 2 detections", "  0.8000  n2  4 5 8 15"]
    assert len(run("1.png --threshold 0.9").out.splitlines()) == 1
    picture, image = cv2.imread("found.png"), cv2.imread("1.png")
    assert picture.shape == image.shape
    assert (picture[15, 4:8] != image[15, 4:8]).any(axis=1).all()
    run("0.png 2.png --draw pictures")
    assert [cv2.imread(f"pictures/{n}.jpg").shape for n in (0, 2)] == [
        (*SHAPES[0], 3),
        (*SHAPES[2], 3),
    ]
