"""WindowData."""

import math

import cv2
import numpy as np
import pytest

import netlib
from tests.support.bad_input import bad_inputs
from tests.support.caffe_messages import write_blob

pytestmark = pytest.mark.both_engines

H, W = 12, 16


@pytest.fixture
def images(tmp_path, rng):
    """Two images."""
    found = [rng.integers(0, 256, (H, W, 3)).astype(np.uint8) for _ in range(2)]
    for i, image in enumerate(found):
        cv2.imwrite(str(tmp_path / f"{i}.png"), image)
    return found


def write_list(folder, *windows):
    """Write a list with windows ``(class, overlap, x1, y1, x2, y2)`` for each image."""
    lines = []
    for i, some in enumerate(windows):
        lines += [f"# {i}", f"{folder}/{i}.png", "3", str(H), str(W), str(len(some))]
        lines += [" ".join(map(str, window)) for window in some]
    (folder / "windows.txt").write_text("\n".join(lines))


def text(folder, options="batch_size: 2 fg_fraction: 0.5", transform="crop_size: 4"):
    """Return a layer that reads the list."""
    return (f'layer {{ name: "d" type: "WindowData" top: "x" top: "t" window_data_param '
            f'{{ source: "{folder}/windows.txt" {options} }} transform_param {{ {transform} }} }}')


def part(image, x1, y1, x2, y2, width=4, height=4):
    """Return the resized part of an image between two corners, both included."""
    cut = image[y1 : y2 + 1, x1 : x2 + 1]
    return cv2.resize(cut, (width, height), interpolation=cv2.INTER_LINEAR).transpose(2, 0, 1).astype(np.float32)


def test_by_hand(tmp_path, images, net_of):
    """Background windows come first; both corners are included, and a window of the right size is not resized."""
    write_list(tmp_path, [(5, 0.75, 2, 3, 5, 6), (5, 0.25, 1, 2, 8, 4)])
    tops = net_of(text(tmp_path)).forward()
    assert tops["t"].tolist() == [0, 5]
    assert np.array_equal(tops["x"][0], part(images[0], 1, 2, 8, 4))
    assert np.array_equal(tops["x"][1], images[0][3:7, 2:6].transpose(2, 0, 1))


def test_a_border_that_leaves_the_image_is_0(tmp_path, images, net_of):
    """A 2 x 2 window in the corner: with a border of 1 of 4 pixels it covers pixels -1 to 3, five of them.

    Of four pixels of the result, one is for the pixel outside (4/5 rounded) and three are for the four inside.
    """
    write_list(tmp_path, [(1, 1, 0, 0, 1, 1), (1, 0, W - 2, H - 2, W - 1, H - 1)])
    first, second = net_of(text(tmp_path, "batch_size: 2 fg_fraction: 0.5 context_pad: 1")).forward()["x"][::-1]
    assert (first[:, 0] == 0).all()
    assert (first[:, :, 0] == 0).all()
    assert np.array_equal(first[:, 1:, 1:], part(images[0], 0, 0, 3, 3, 3, 3))
    # the other corner covers pixels W - 3 to W + 1, two of them outside: 4/5 * 2 rounds to 2, and so does 4/5 * 3
    assert np.array_equal(second[:, :2, :2], part(images[0], W - 3, H - 3, W - 1, H - 1, 2, 2))
    assert (second[:, 2:] == 0).all()
    assert (second[:, :, 2:] == 0).all()


def as_caffe(image, window, size, pad, square, mirror, real, mean=0.0, scale=1.0):
    """Compute one window statement by statement as Caffe does, in the type ``real``."""

    def rounded(v):
        return int(math.copysign(math.floor(abs(float(v)) + 0.5), v))

    x1, y1, x2, y2 = window
    width = height = size
    pad_w = pad_h = 0
    if pad > 0 or square:
        context_scale = real(size) / real(size - 2 * pad)
        half_height, half_width = real(real(y2 - y1 + 1) / 2), real(real(x2 - x1 + 1) / 2)
        center_x, center_y = real(x1) + half_width, real(y1) + half_height
        if square:
            half_width = half_height = max(half_width, half_height)
        x1, x2 = rounded(center_x - half_width * context_scale), rounded(center_x + half_width * context_scale)
        y1, y2 = rounded(center_y - half_height * context_scale), rounded(center_y + half_height * context_scale)
        unclipped_height, unclipped_width = y2 - y1 + 1, x2 - x1 + 1
        pad_x1, pad_y1 = max(0, -x1), max(0, -y1)
        pad_x2, pad_y2 = max(0, x2 - image.shape[1] + 1), max(0, y2 - image.shape[0] + 1)
        x1, x2, y1, y2 = x1 + pad_x1, x2 - pad_x2, y1 + pad_y1, y2 - pad_y2
        scale_x, scale_y = real(size) / real(unclipped_width), real(size) / real(unclipped_height)
        width, height = rounded(real(x2 - x1 + 1) * scale_x), rounded(real(y2 - y1 + 1) * scale_y)
        pad_x1, pad_x2 = rounded(real(pad_x1) * scale_x), rounded(real(pad_x2) * scale_x)
        pad_h, pad_w = rounded(real(pad_y1) * scale_y), pad_x2 if mirror else pad_x1
        height, width = min(height, size - pad_h), min(width, size - pad_w)
    cut = cv2.resize(image[y1 : y2 + 1, x1 : x2 + 1], (width, height), interpolation=cv2.INTER_LINEAR)
    if mirror:
        cut = cv2.flip(cut, 1)
    y = np.zeros((3, size, size), real)
    mean = np.broadcast_to(np.asarray(mean, real), y.shape)
    for h in range(height):
        for w in range(width):
            for c in range(3):
                y[c, h + pad_h, w + pad_w] = (real(cut[h, w, c]) - mean[c, h + pad_h, w + pad_w]) * real(scale)
    return y


@pytest.mark.parametrize("real", [np.float32, np.float64])
@pytest.mark.parametrize("square", [False, True])
@pytest.mark.parametrize("pad", [0, 1, 2])
def test_any_window_is_cut_as_caffe_cuts_it(tmp_path, images, net_of, rng, real, square, pad):
    """Borders, squares, mirrors, the centre of a mean image and the layer's own scale agree with Caffe."""
    mean = rng.normal(size=(1, 3, 9, 11)).astype(np.float32)
    write_blob(tmp_path / "mean", mean)
    options = f'context_pad: {pad} crop_mode: "{"square" if square else "warp"}" scale: 0.5 batch_size: 24'
    transform = f'crop_size: 7 mirror: true scale: 100 mean_file: "{tmp_path}/mean"'
    left, top = rng.integers(0, W - 2, 40), rng.integers(0, H - 2, 40)
    corners = [(x, y, rng.integers(x, W), rng.integers(y, H)) for x, y in zip(left, top)]
    write_list(tmp_path, [(7 + i, 0.9, *corner) for i, corner in enumerate(corners[1:])] + [(0, 0, *corners[0])])
    net = net_of(text(tmp_path, f"{options} fg_fraction: 0.9", transform), dtype=real)
    seen = set()
    for _ in range(8):
        tops = net.forward()
        for x, t in zip(tops["x"], tops["t"]):
            corner = corners[int(t) - 6 if t else 0]
            want = [as_caffe(images[0], corner, 7, pad, square, mirror, real, mean[0, :, 2:9, 2:9], 0.5)
                    for mirror in (False, True)]
            found = [mirror for mirror in (0, 1) if np.allclose(x, want[mirror], rtol=1e-6, atol=1e-6)]
            assert found
            seen.add((int(t), found[0]))
    assert len(seen) > 60


def test_mean_values(tmp_path, images, net_of):
    """One mean per channel is subtracted; pixels outside the image stay 0."""
    write_list(tmp_path, [(1, 1, 0, 0, 1, 1), (0, 0, 2, 2, 5, 5)])
    transform = "crop_size: 4 mean_value: 1 mean_value: 2 mean_value: 3"
    x = net_of(text(tmp_path, "batch_size: 2 fg_fraction: 0.5 context_pad: 1", transform)).forward()["x"][1]
    want = as_caffe(images[0], (0, 0, 1, 1), 4, 1, False, False, np.float32, np.array([1, 2, 3.0]).reshape(3, 1, 1))
    assert np.array_equal(x, want)
    assert (x[:, 0] == 0).all()


def test_which_windows_are_foreground(tmp_path, images, net_of):
    """Two thresholds select foreground and background; windows between them are unused, and background is class 0."""
    write_list(tmp_path, [(1, 0.6, 0, 0, 3, 3), (2, 0.5, 1, 1, 4, 4)], [(3, 0.4, 0, 0, 3, 3), (4, 0.1, 2, 2, 5, 5)])
    layer = net_of(text(tmp_path, "batch_size: 1 fg_threshold: 0.5 bg_threshold: 0.4")).layer_dict["d"]
    assert [(w.path, w.label, w.x1) for w in layer.foreground] == [(f"{tmp_path}/0.png", n, n - 1) for n in (1, 2)]
    assert [(w.path, w.label, w.x1) for w in layer.background] == [(f"{tmp_path}/1.png", 0, 2)]
    assert layer.notes == [f"2 foreground and 1 background windows in {tmp_path}/windows.txt"]


@pytest.mark.parametrize(("size", "fraction", "count"), [(8, 0.25, 2), (7, 0.5, 3), (10, 0.7, 7), (3, 0, 0), (3, 1, 3)])
def test_how_many_are_foreground(tmp_path, images, net_of, size, fraction, count):
    """The number of foreground windows is rounded down, computed in float32."""
    write_list(tmp_path, [(1, 1, 0, 0, 3, 3), (0, 0, 1, 1, 4, 4)])
    t = net_of(text(tmp_path, f"batch_size: {size} fg_fraction: {fraction}")).forward()["t"]
    assert t.tolist() == [0] * (size - count) + [1] * count


def test_every_window_is_chosen_equally_often(tmp_path, images, net_of):
    """Windows of both images are drawn equally often; restoring the state repeats the choice."""
    write_list(tmp_path, *([(1 + 3 * k + i, 1, i, i, i + 3, i + 3) for i in range(3)] for k in range(2)))
    with (tmp_path / "windows.txt").open("a") as file:
        file.write(f" # 2 {tmp_path}/0.png 3 1 1 1 0 0 0 0 1 1")
    net = net_of(text(tmp_path, "batch_size: 60 fg_fraction: 1", "crop_size: 2 mirror: true"))
    counts = np.bincount(np.concatenate([net.forward()["t"].astype(int) for _ in range(10)]), minlength=7)
    assert counts[0] == 0
    assert counts[1:].min() > 60
    states = netlib.snapshots.snapshot.as_plain(net.layer_states())
    x = net.forward()["x"].copy()
    net.restore_layer_states(states)
    assert np.array_equal(net.forward()["x"], x)


def test_root_folder(tmp_path, images, net_of):
    """root_folder is prepended to the paths as text."""
    write_list(tmp_path, [(1, 1, 0, 0, 3, 3), (0, 0, 1, 1, 4, 4)])
    (tmp_path / "windows.txt").write_text((tmp_path / "windows.txt").read_text().replace(f"{tmp_path}/0.png", "0.png"))
    options = "batch_size: 2 cache_images: true"
    net_of(text(tmp_path, options)).forward()  # relative to the list's folder
    net_of(text(tmp_path, f'{options} root_folder: "{tmp_path}/"')).forward()
    with pytest.raises(netlib.DataError, match=r"x0.png: cannot read the image"):
        net_of(text(tmp_path, f'{options} root_folder: "{tmp_path}/x"')).forward()


BOTH = "1 1 0 0 3 3 0 0 0 0 3 3"


@bad_inputs(netlib.DataError, {
    "missing": (None, "...windows.txt: cannot read the list of windows: No such file or directory"),
    "no window": ("", "...windows.txt: the list of windows is empty"),
    "0 a.png": "...windows.txt: found '0', expected '#' and image 0",
    "# 1 0.png 3 2 2 0": "...windows.txt: image 0: has number 1; expected images numbered from 0",
    "# 0 0.png 3 2 2": "...windows.txt: image 0: the number of windows: the list ends, expected an integer",
    "# 0 0.png 3 x": "...windows.txt: image 0: height: found 'x', expected an integer",
    "# 0 0.png 3 2 2 1 1 a": "...windows.txt: image 0: the overlap of window 0: found 'a', expected a number",
    "# 0 0.png 3 2 2 1 1 1 0 0 3.5 3": "...windows.txt: image 0: x2 of window 0: found '3.5', expected an integer",
    f"# 0 0.png 3 2 2 2 {BOTH} 7": "...windows.txt: found '7', expected '#' and image 1",
    f"# 0 0.png 1 2 2 2 {BOTH}": "...windows.txt: image 0 has 1 channels; images are read in colour, expected 3",
    "# 0 0.png 3 2 2 1 1 1 0 0 3 3": "...windows.txt: 1 foreground and 0 background windows; expected some of both",
    "# 0 0.png 3 2 2 1 0 1 0 0 3 3":
        "...windows.txt: a foreground window of 0.png has class 0; expected 1 or more, as 0 is the background",
    "# 0 gone.png 3 2 2 2 " + BOTH: "gone.png: cannot read the image: No such file or directory",
    "# 0 0.png 3 2 2 2 1 1 0 0 16 3 0 0 0 0 3 3":
        "...windows.txt: window (0, 0, 16, 3) is outside 0.png, which has 16 columns and 12 rows",
    "# 0 0.png 3 2 2 2 1 1 5 5 3 9 0 0 0 0 3 3":
        "...windows.txt: window (5, 5, 3, 9) of 0.png ends before it starts; expected x1 y1 x2 y2",
})
def test_lists_with_something_wrong_in_them(tmp_path, images, net_of, given, rejected):
    """The error states the position, the invalid and the expected content."""
    if given is not None:
        (tmp_path / "windows.txt").write_text(given)
    with rejected:
        net_of(text(tmp_path)).forward()


@bad_inputs(netlib.LayerError, {
    f"{options} {transform}": ((options, transform), f"...net.prototxt:1:...: error: layer 'd': {line}")
    for options, transform, line in (
        ("batch_size: 0", "crop_size: 4", "batch_size must be at least 1"),
        ("batch_size: 1", "", "needs transform_param { crop_size: ... }, the size of its windows"),
        ("batch_size: 1 context_pad: 2", "crop_size: 4", "context_pad 2 on both sides exceeds crop_size 4"),
        ("batch_size: 1 fg_fraction: 1.5", "crop_size: 4", "fg_fraction 1.5 must be from 0 to 1"),
        ('batch_size: 1 crop_mode: "sqare"', "crop_size: 4",
         "crop_mode 'sqare' must be 'warp' or 'square' (did you mean 'square'?)"),
        ("batch_size: 1", "crop_size: 4 mean_value: 1 mean_value: 2", "has 2 mean_value, expected 1 or 3"),
        ("batch_size: 1", 'crop_size: 9 mean_file: "m"',
         "mean_file 'm' has shape (3, 8, 8), too small for a crop of (3, 9, 9)"))
})
def test_options_that_do_not_go_together(tmp_path, images, given, rejected):
    """Invalid combinations of options raise an error when the net is built."""
    write_list(tmp_path, [(1, 1, 0, 0, 3, 3), (0, 0, 1, 1, 4, 4)])
    write_blob(tmp_path / "m", np.zeros((1, 3, 8, 8)))
    (tmp_path / "net.prototxt").write_text(text(tmp_path, *given))
    with rejected:
        netlib.Net(tmp_path / "net.prototxt", netlib.TRAIN)
