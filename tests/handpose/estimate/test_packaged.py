"""handpose/estimate/packaged.py: the weights that are part of the repository."""

from __future__ import annotations

import io
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import h5py
import numpy as np
import pytest

import netlib
from handpose.estimate.packaged import (
    HAND_FINDER,
    SYNTHETIC_HAND,
    checked_content,
    load_finder,
    load_predictor,
    read_card,
)
from handpose.fit.body import CapsuleModel
from handpose.fit.network_errors import read_errors
from handpose.fit.settings import SearchSettings
from netlib.errors import NetlibError, WeightsError
from netlib.snapshots import snapshot
from tests.support.bad_input import bad_inputs


@pytest.mark.parametrize(("folder", "megabytes"), [(SYNTHETIC_HAND, 12), (HAND_FINDER, 3)])
def test_the_packaged_models(folder: Path, megabytes: int) -> None:
    """They are small, and their nets use all weights."""
    card = read_card(folder)
    weights = checked_content(card).path
    assert card.license == "MIT" and weights.stat().st_size < megabytes * 1e6
    ignored, missing = netlib.Net(card.net, netlib.TEST).copy_from(weights)
    assert not ignored and not missing


def test_the_hand_of_the_unit_tests_is_the_packaged_one(model: CapsuleModel) -> None:
    fitter = load_predictor().fitter
    assert fitter is not None and fitter.model.skeleton.param == model.skeleton.param
    assert fitter.model.unit_mm == model.unit_mm


def test_the_errors_of_the_packaged_network_are_known(model: CapsuleModel) -> None:
    errors = read_errors(checked_content(read_card(SYNTHETIC_HAND)), model)
    assert errors.is_measured and errors.poses is not None
    assert 0.02 < np.sqrt(np.diag(errors.limbs)).mean() < 0.5
    assert (
        load_predictor().plan == SearchSettings().accurate
        and load_predictor(fit="no", hand="left").fitter is None
    )


@pytest.mark.parametrize("load", [load_predictor, load_finder])
def test_weights_are_read_once(
    monkeypatch: pytest.MonkeyPatch, forget_weights: Callable[[], None], load: Callable[[], object]
) -> None:
    """Checksum, weights and the network's errors come from one read of the file."""
    forget_weights()
    read, parsed = mock.Mock(wraps=snapshot.read_content), mock.Mock(wraps=h5py.File)
    monkeypatch.setattr(snapshot, "read_content", read)
    monkeypatch.setattr(h5py, "File", parsed)
    load()
    assert read.call_count == 1
    assert parsed.call_count and all(
        isinstance(call.args[0], io.BytesIO) for call in parsed.call_args_list
    )


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of the model's folder, to be damaged."""
    return Path(shutil.copytree(SYNTHETIC_HAND, tmp_path / "model"))


def flipped(data: bytes) -> bytes:
    """A file with a flipped bit."""
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


def with_code(data: bytes) -> bytes:
    """A net with a layer that would run a program."""
    return (
        data + b'layer { name: "p" type: "Python" python_param { module: "evil" layer: "Evil" } }\n'
    )


@pytest.mark.parametrize(
    ("name", "changed", "line"),
    [
        ("synthetic_hand.caffemodel.h5", flipped, "SHA-256 .*the file is damaged"),
        ("synthetic_hand.caffemodel.h5", None, "cannot read weights: No such file"),
        ("deploy.prototxt", with_code, "SHA-256 .*the file is damaged"),
        ("deploy.prototxt", None, "cannot read the net: No such file"),
    ],
)
def test_a_model_that_was_changed(
    copy: Path, name: str, changed: Callable[[bytes], bytes] | None, line: str
) -> None:
    """A changed or missing file raises an error before the net is run."""
    path = copy / name
    data = path.read_bytes()
    path.unlink() if changed is None else path.write_bytes(changed(data))
    for load in (lambda: load_predictor(folder=copy), lambda: load_finder(copy)):
        with pytest.raises(WeightsError, match=f"{name}: {line}"):
            load()


def test_other_line_ends(copy: Path) -> None:
    net = copy / "deploy.prototxt"
    net.write_bytes(net.read_bytes().replace(b"\n", b"\r\n"))
    assert load_predictor(folder=copy, fit="no", hand="right").fitter is None


FIELDS = "expected name, caffemodel, license, sha256, net_sha256"


@bad_inputs(
    NetlibError,
    {
        "missing": (None, "...readme.md: cannot read the model's card: No such file or directory"),
        "no fields": (
            "# A model",
            "...readme.md: no front matter; expected lines 'key: value' between two lines '---'",
        ),
        "no weights": (
            "---\nname: x\n---\n",
            f"...readme.md: no 'caffemodel' in the front matter; {FIELDS}",
        ),
        "no license": (
            "---\nname: x\ncaffemodel: a\nlicense:\nsha256: 0\n---\n",
            f"...readme.md: no 'license' in the front matter; {FIELDS}",
        ),
    },
)
def test_invalid_model_cards_are_rejected(copy: Path, given: str | None, rejected: Any) -> None:
    """The error names the file."""
    card = copy / "readme.md"
    card.unlink()
    if given is not None:
        card.write_text(given)
    with rejected:
        load_predictor(folder=copy)
