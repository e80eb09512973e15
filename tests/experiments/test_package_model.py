"""experiments/package_model.py: the rounded weights and their file"""

from __future__ import annotations

import shlex
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

import netlib
from experiments import fit
from experiments.package_model import rounded, write_model
from handpose.estimate.packaged import HAND_FINDER, PAPER_HAND, SYNTHETIC_HAND, read_card
from handpose.fit.body import CapsuleModel
from handpose.fit.network_errors import NetworkErrors, read_errors
from handpose.synthetic import generator
from netlib.files.paths import ROOT
from tests.support.packaged_hand import SKELETON
from tests.support.running import run_tool


@example(12.0, 0, False)
@example(1.25, 1, False)
@given(st.floats(2.0**-100, 2.0**100, width=32), st.integers(0, 23), st.booleans())
def test_rounding(value: float, bits: int, negative: bool) -> None:
    """A mantissa becomes the nearest one whose last bits are 0, ties to even; the shape is
    unchanged.
    """
    drop = 23 - bits
    kept = int(np.float32(value).view(np.uint32)) >> drop
    both = np.array([kept << drop, kept + 1 << drop], np.uint32)
    below, above = both.view(np.float32).tolist()
    is_odd = not bits or kept % 2 == 1  # without bits, the leading one, which is not stored
    middle = (below + above) / 2
    expected = above if value > middle or (value == middle and is_odd) else below
    sign = -1 if negative else 1
    number = np.float32([[sign * value, 0]])
    assert_array_equal(rounded(number, bits), np.float32([[sign * expected, 0]]))


def test_a_model_file(tmp_path: Path) -> None:
    """The file is read back as weights and as the network's errors, and is smaller
    than its numbers.
    """
    net = netlib.Net(HAND_FINDER / "deploy.prototxt", netlib.TEST, seed=3)
    path = tmp_path / "x.caffemodel.h5"
    for blobs in net.params.values():
        for blob in blobs:
            blob.data[...] = rounded(blob.data, 8)
    errors = NetworkErrors(np.eye(20) * 0.1)
    write_model(net, errors, path)
    again = netlib.Net(HAND_FINDER / "deploy.prototxt", path, netlib.TEST)
    for name, blobs in net.params.items():
        for one, other in zip(blobs, again.params[name]):
            assert_array_equal(one.data, other.data)
    assert_array_equal(read_errors(path, CapsuleModel(SKELETON, 150.0)).limbs, errors.limbs)
    numbers = sum(blob.count for blobs in net.params.values() for blob in blobs)
    assert numbers > 10_000 and path.stat().st_size < 0.7 * 4 * numbers


def command_of(folder: Path) -> list[str]:
    """The words of the packaging command in a model's card, from ``package_model`` on."""
    text = (folder / "readme.md").read_text(encoding="utf-8").replace("\\\n", " ")
    [line] = [
        line for line in text.splitlines() if line.startswith("python -m experiments package_model")
    ]
    return shlex.split(line)[3:]


def structure_of(path: Path) -> dict[str, object]:
    """The groups, data sets and attributes of an HDF5 file, without their values."""
    with h5py.File(path) as file:
        found: dict[str, object] = {"/": dict(file.attrs)}

        def add(name: str, item: h5py.Group | h5py.Dataset) -> None:
            found[name] = dict(item.attrs)
            if isinstance(item, h5py.Dataset):
                stored = item.chunks, item.compression, item.compression_opts, item.shuffle
                found[name] = item.shape, item.dtype, stored, dict(item.attrs)

        file.visititems(add)
    return found


@pytest.mark.parametrize(
    "folder", [SYNTHETIC_HAND, PAPER_HAND, HAND_FINDER], ids=lambda folder: folder.name
)
def test_the_command_of_a_card_makes_its_file(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names, shapes, types and attributes are those of the packaged file; so are the weights,
    which are rounded.
    """
    for module in (generator, fit):
        monkeypatch.setattr(module, "BLOCK", 24)
    card, words = read_card(folder), command_of(folder)
    model, out = words.index("--model") + 1, words.index("--out") + 1
    assert (ROOT / words[model], ROOT / words[out]) == (card.net, card.weights)
    words[1], words[model], words[out] = str(card.weights), str(card.net), str(tmp_path / "made.h5")
    run_tool("experiments.__main__", *words, "--frames", "1")
    assert structure_of(tmp_path / "made.h5") == structure_of(card.weights)
    packaged, made = (
        netlib.Net(card.net, path, netlib.TEST) for path in (card.weights, tmp_path / "made.h5")
    )
    for name, blobs in packaged.params.items():
        for one, other in zip(blobs, made.params[name], strict=True):
            assert_array_equal(one.data, other.data)
