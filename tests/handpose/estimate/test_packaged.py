"""handpose/estimate/packaged.py: the weights that are part of the repository."""

from __future__ import annotations

import ast
import io
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import netlib
from handpose.estimate.packaged import (
    HAND_FINDER,
    SYNTHETIC_HAND,
    checked_weights,
    load_finder,
    load_predictor,
    read_card,
)
from handpose.fit.body import CapsuleModel
from handpose.fit.network_errors import read_errors
from handpose.fit.search import PLANS
from layers.hand import skeleton
from netlib.errors import NetlibError, WeightsError
from netlib.files import Content
from netlib.files.paths import ROOT
from netlib.snapshots import snapshot
from tests.support.bad_input import bad_inputs

MEGABYTE = 1e6


def test_the_packaged_model() -> None:
    """The model is small and complete, its errors are known, and its net uses all weights."""
    card = read_card(SYNTHETIC_HAND)
    weights = checked_weights(card)
    assert card.license == "MIT" and weights.stat().st_size < 12 * MEGABYTE
    errors = read_errors(weights, CapsuleModel(skeleton.load(), 150.0))
    assert errors.is_measured and errors.poses is not None
    assert 0.02 < np.sqrt(np.diag(errors.limbs)).mean() < 0.5
    ignored, missing = netlib.Net(SYNTHETIC_HAND / "deploy.prototxt", netlib.TEST).copy_from(weights)
    assert not ignored and not missing
    assert load_predictor().plan is PLANS["accurate"] and load_predictor(fit="no", hand="left").fitter is None


def test_the_packaged_finder() -> None:
    """It is small, and its net uses all weights."""
    weights = checked_weights(read_card(HAND_FINDER))
    assert weights.stat().st_size < 3 * MEGABYTE
    ignored, missing = netlib.Net(HAND_FINDER / "deploy.prototxt", netlib.TEST).copy_from(weights)
    assert not ignored and not missing


@pytest.mark.parametrize("load", [load_predictor, load_finder])
def test_weights_are_read_once(
    monkeypatch: pytest.MonkeyPatch, forget_weights: Callable[[], None], load: Callable[[], object]
) -> None:
    """Checksum, weights and the network's errors come from one read of the file."""
    forget_weights()
    read, read_content = [], snapshot.read_content
    parsed, file = [], h5py.File

    def read_noted(path: Path) -> Content:
        read.append(path)
        return read_content(path)

    def file_noted(source: object, *more: Any, **options: Any) -> h5py.File:
        parsed.append(source)
        return file(source, *more, **options)

    monkeypatch.setattr(snapshot, "read_content", read_noted)
    monkeypatch.setattr(h5py, "File", file_noted)
    load()
    assert len(read) == 1 and parsed and all(isinstance(source, io.BytesIO) for source in parsed)


def test_models_are_installed() -> None:
    """Every folder with a model card is a package whose files are package data."""
    said = ast.parse((ROOT / "setup.py").read_text(encoding="utf-8"))
    shared = next(
        node.value for node in said.body if isinstance(node, ast.Assign) and ast.unparse(node).startswith("SHARED")
    )
    data = next(node.value for node in ast.walk(said) if isinstance(node, ast.keyword) and node.arg == "package_data")
    assert "models" in ast.literal_eval(shared)
    assert {"*.prototxt", "*.md", "*.h5"} <= set(ast.literal_eval(data)[""])
    for card in (ROOT / "models").glob("*/readme.md"):
        assert (card.parent / "__init__.py").is_file()


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the model's folder, to be damaged."""
    return Path(shutil.copytree(SYNTHETIC_HAND, tmp_path / "model"))


def test_damaged_weights(copy: Path) -> None:
    """A flipped bit, or a missing file, raises an error."""
    path = read_card(copy).weights
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2] ^= 1
    path.write_bytes(raw)
    with pytest.raises(WeightsError, match=r"synthetic_hand.caffemodel.h5: SHA-256 .*the file is damaged"):
        load_predictor(folder=copy)
    path.unlink()
    with pytest.raises(WeightsError, match="cannot read weights: No such file"):
        load_predictor(folder=copy)


def test_a_changed_net(copy: Path) -> None:
    """A modified net raises an error before it is run; other line endings are accepted."""
    net = copy / "deploy.prototxt"
    text = net.read_bytes()
    net.write_bytes(text.replace(b"\n", b"\r\n"))
    assert load_predictor(folder=copy, fit="no", hand="right").fitter is None
    net.write_bytes(text + b'layer { name: "p" type: "Python" python_param { module: "evil" layer: "Evil" } }\n')
    with pytest.raises(WeightsError, match=r"deploy.prototxt: SHA-256 .*the file is damaged"):
        load_predictor(folder=copy)
    with pytest.raises(WeightsError, match=r"deploy.prototxt: SHA-256 .*the file is damaged"):
        load_finder(copy)
    net.unlink()
    with pytest.raises(WeightsError, match=r"deploy.prototxt: cannot read the net: No such file"):
        load_predictor(folder=copy)


FIELDS = "expected name, caffemodel, license, sha256, net_sha256"


@bad_inputs(NetlibError, {
    "missing": (None, "...readme.md: cannot read the model's card: No such file or directory"),
    "no fields": ("# A model", "...readme.md: no front matter; expected lines 'key: value' between two lines '---'"),
    "no weights": ("---\nname: x\n---\n", f"...readme.md: no 'caffemodel' in the front matter; {FIELDS}"),
    "no license": ("---\nname: x\ncaffemodel: a\nlicense:\nsha256: 0\n---\n",
                   f"...readme.md: no 'license' in the front matter; {FIELDS}"),
})
def test_cards_with_something_wrong(copy: Path, given: str | None, rejected: Any) -> None:
    """An invalid model card raises an error that names the file."""
    card = copy / "readme.md"
    card.unlink()
    if given is not None:
        card.write_text(given)
    with rejected:
        load_predictor(folder=copy)
