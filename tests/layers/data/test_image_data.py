"""ImageData."""

import cv2
import numpy as np
import pytest

import netlib
from tests.support.bad_input import bad_inputs

SIZES = [(4, 6), (4, 6), (4, 6), (5, 8), (3, 3)]


@pytest.fixture
def pictures(tmp_path, rng):
    """Five images, the last two of other sizes, and a list of the first three with
    labels 10, 11, 12.
    """
    found = []
    for i, size in enumerate(SIZES):
        found.append(rng.integers(0, 256, (*size, 3)).astype(np.uint8))
        cv2.imwrite(str(tmp_path / f"picture {i}.png"), found[-1])
    write_list(tmp_path, range(3))
    return found


def write_list(folder, numbers):
    (folder / "list.txt").write_text("".join(f"picture {i}.png {10 + i}\n" for i in numbers))


def text(folder, options="", more=""):
    return (
        f'layer {{ name: "d" type: "ImageData" top: "x" top: "t" image_data_param '
        f'{{ source: "{folder}/list.txt" {options} }} {more} }}'
    )


def labels(net, count=1):
    """Return the labels of the next batches."""
    return [int(t) for _ in range(count) for t in net.forward()["t"]]


def test_pictures_come_in_order_and_go_round(tmp_path, pictures, net_of):
    """Images are (C, H, W) with blue first; paths may contain spaces and are relative to the
    list's folder.
    """
    net = net_of(text(tmp_path, "batch_size: 2"))
    for first, second in ((0, 1), (2, 0), (1, 2)):
        tops = net.forward()
        assert tops["t"].tolist() == [10 + first, 10 + second]
        for x, i in zip(tops["x"], (first, second)):
            assert np.array_equal(x, pictures[i].transpose(2, 0, 1))


@pytest.mark.parametrize("color", [True, False])
def test_resized(tmp_path, pictures, net_of, color):
    """Images are resized by linear interpolation, so that a batch may contain different sizes."""
    write_list(tmp_path, range(5))
    net = net_of(
        text(tmp_path, f"batch_size: 5 new_height: 7 new_width: 9 is_color: {str(color).lower()}")
    )
    x = net.forward()["x"]
    assert x.shape == (5, 3 if color else 1, 7, 9)
    for i in range(5):
        picture = cv2.imread(str(tmp_path / f"picture {i}.png"), int(color))
        want = cv2.resize(picture, (9, 7)).reshape(7, 9, -1).transpose(2, 0, 1)
        assert np.array_equal(x[i], want)


def test_a_batch_has_the_size_of_its_first_picture(tmp_path, pictures, net_of):
    write_list(tmp_path, [0, 3, 4])
    net = net_of(text(tmp_path) + 'layer { name: "r" type: "ReLU" bottom: "x" top: "y" }')
    for i in (0, 3, 4, 0):
        assert np.array_equal(net.forward()["y"][0], pictures[i].transpose(2, 0, 1))


def test_cropped(tmp_path, pictures, net_of):
    write_list(tmp_path, range(5))
    net = net_of(
        text(tmp_path, "batch_size: 5", "transform_param { crop_size: 3 mean_value: 4 }"),
        netlib.TEST,
    )
    x = net.forward()["x"]
    middle = pictures[3].transpose(2, 0, 1)[:, 1:4, 2:5]
    assert np.array_equal(x[3], middle - 4.0)
    assert np.array_equal(x[4], pictures[4].transpose(2, 0, 1) - 4.0)


def test_shuffle(tmp_path, pictures, net_of):
    """Every pass has all images in a new order, which depends on the seed."""
    net = net_of(text(tmp_path, "shuffle: true"), seed=4)
    found = labels(net, 60)
    passes = {tuple(found[i : i + 3]) for i in range(0, 60, 3)}
    assert all(sorted(one) == [10, 11, 12] for one in passes)
    assert len(passes) == 6
    assert labels(net_of(text(tmp_path, "shuffle: true"), seed=4), 60) == found


def test_rand_skip(tmp_path, pictures, net_of):
    starts = set()
    for seed in range(20):
        found = labels(net_of(text(tmp_path, "rand_skip: 2"), seed=seed), 3)
        starts.add(found[0])
        assert found == [10 + (found[0] - 10 + i) % 3 for i in range(3)]
    assert starts == {10, 11}


@pytest.mark.parametrize("done", [0, 1, 2, 5])
def test_a_resume_goes_on_with_the_next_picture(tmp_path, pictures, net_of, done):
    options = text(
        tmp_path,
        "batch_size: 2 shuffle: true rand_skip: 3",
        "transform_param { crop_size: 2 mirror: true }",
    )
    net = net_of(options, seed=1)
    labels(net, done)
    states = netlib.snapshots.snapshot.as_plain(net.layer_states())
    want = [net.forward()["x"].copy() for _ in range(6)]
    other = net_of(options, seed=2)
    labels(other, 1)
    other.restore_layer_states(states)
    assert np.array_equal(want, [other.forward()["x"].copy() for _ in range(6)])


def test_a_resume_with_another_list_starts_over(tmp_path, pictures, net_of):
    net = net_of(text(tmp_path))
    labels(net, 2)
    states = net.layer_states()
    write_list(tmp_path, [2, 1, 0])
    other = net_of(text(tmp_path))
    other.restore_layer_states(states)
    assert labels(other) == [12]


def test_root_folder_is_prepended_to_the_paths(tmp_path, pictures, net_of, monkeypatch):
    """It is prepended as text; without it, paths are relative to the working directory or
    the list.
    """
    (tmp_path / "a_list").mkdir()
    (tmp_path / "a_list" / "list.txt").write_text("ture 1.png 1")
    with pytest.raises(netlib.DataError, match="cannot read the image"):
        net_of(text(tmp_path / "a_list"))
    assert labels(net_of(text(tmp_path / "a_list", f'root_folder: "{tmp_path}/pic"'))) == [1]
    monkeypatch.chdir(tmp_path)
    assert labels(net_of(text(tmp_path / "a_list", 'root_folder: "pic"'))) == [1]
    monkeypatch.chdir(tmp_path / "a_list")
    assert labels(net_of(text(tmp_path))) == [10]


@pytest.mark.parametrize(
    ("content", "found"),
    [("picture 0.png 5\n\npicture 1.png -3\r\n", [5, -3]), ("picture 0.png +7", [7])],
)
def test_lines(tmp_path, pictures, net_of, content, found):
    (tmp_path / "list.txt").write_bytes(content.encode())
    assert labels(net_of(text(tmp_path, f"batch_size: {len(found)}"))) == found


def test_notes(tmp_path, pictures, net_of, caplog):
    net = net_of(text(tmp_path, "mirror: true")[:-1] + "transform_param { force_gray: true } }")
    assert net.layer_dict["d"].notes == [f"3 images in {tmp_path}/list.txt"]
    assert (
        "ImageData ignores mirror in image_data_param, as Caffe does; write it in transform_param"
        in caplog.text
    )
    assert (
        "ImageData ignores force_gray in transform_param, as Caffe does; write is_color"
        in caplog.text
    )


AT = "net.prototxt:1:...: error: layer 'd': "


@bad_inputs(
    netlib.DataError,
    {
        "no list": (
            (None, ""),
            "...list.txt: cannot read the list of images: No such file or directory",
        ),
        "empty list": ((b"\n", ""), "...list.txt: the list of images is empty"),
        "bytes": (
            (b"\xff\xfe", ""),
            "...list.txt: cannot read the list of images: not a text file (byte 0 is not UTF-8)",
        ),
        "no label": (
            (b"picture 0.png 1\na.png", ""),
            "...list.txt:2: 'a.png' has no label; expected 'path label'",
        ),
        "a space for a label": (
            (b"a.png ", ""),
            "...list.txt:1: 'a.png' has no label; expected 'path label'",
        ),
        "a label cat": (
            (b"picture 0.png 1\npicture 1.png cat", ""),
            "...list.txt:2: the label 'cat' is not a whole number; expected 'path label'",
        ),
        "a tab": (
            (b"picture0.png\t4", ""),
            "...list.txt:1: found a tab between path and label; expected a space, as in Caffe",
        ),
        "a label 1.5": (
            (b"picture 0.png 1.5", ""),
            "...list.txt:1: the label '1.5' is not a whole number; expected 'path label'",
        ),
        "a long label": (
            (b"picture 0.png 4294967295", ""),
            "...list.txt:1: the label 4294967295 does not fit into 32 bits, as Caffe's labels do",
        ),
        "no image": (
            (b"gone.png 1", ""),
            "gone.png: cannot read the image: No such file or directory",
        ),
        "a text": (
            (b"list.txt 1", ""),
            "...list.txt: not an image that OpenCV can decode (10 bytes)",
        ),
        "empty image": (
            (b"empty 1", ""),
            "...empty: not an image that OpenCV can decode (0 bytes)",
        ),
        "too large": (
            (b"picture 0.png 1", "new_height: 99999 new_width: 99999"),
            "images resized to 99999 x 99999 pixels; expected at most 268435456",
        ),
        "batch_size": (
            (b"picture 0.png 1", "batch_size: 0"),
            netlib.LayerError,
            f"{AT}batch_size must be at least 1",
        ),
        "width alone": (
            (b"picture 0.png 1", "new_width: 3"),
            netlib.LayerError,
            f"{AT}new_height 0 and new_width 3 must be given together",
        ),
        "rand_skip": (
            (b"picture 0.png 1", "rand_skip: 900"),
            netlib.LayerError,
            f"{AT}rand_skip 900 would skip all 1 images of ...list.txt",
        ),
        "another size": (
            (b"picture 0.png 1\npicture 3.png 1", "batch_size: 2"),
            netlib.LayerError,
            "...: layer 'd': picture 3.png: the image (C, H, W) (3, 5, 8) gives (3, 5, 8), "
            "the first of its batch (3, 4, 6); expected the same number of channels, and without ...",
        ),
    },
)
def test_mistakes(tmp_path, pictures, net_of, given, rejected):
    content, options = given
    (tmp_path / "list.txt").unlink()
    (tmp_path / "empty").touch()
    if content is not None:
        (tmp_path / "list.txt").write_bytes(content)
    with rejected:
        net_of(text(tmp_path, options), seed=3).forward()
