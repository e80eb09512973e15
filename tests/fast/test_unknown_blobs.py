"""An access to what neither memory nor a step has is an error until a pass computes it."""

from __future__ import annotations

import numpy as np
import pytest

import netlib
from fast.slices import SlicedStep
from netlib.errors import NetlibError
from tests.support.sliced_nets import (
    CONV,
    OF_X,
    OF_Y,
    PAPER,
    TWO_SIZES,
    UNSTORED,
    Arrays,
    MakeNet,
    batch,
    check_blob,
    everything,
    expected_of,
    feed,
    unstored,
)

pytestmark = pytest.mark.usefixtures("slices_of_any_size")


def interrupt(*args: object) -> None:
    raise KeyboardInterrupt


def test_diffs_of_a_pass_before_are_unknown(net_of: MakeNet) -> None:
    """Data are those of the last forward pass.

    The diffs that it has replaced are an error until the next backward.
    """
    net, expected = net_of(PAPER), expected_of(net_of, batch(3))
    everything(net, batch(5))
    feed(net, batch(3))
    check_blob(net, "c1", "data", expected)
    net = net_of(PAPER)
    everything(net, batch(3, seed=1))
    feed(net, batch(3))
    check_blob(net, "c1", "data", expected)
    with pytest.raises(
        NetlibError, match=r"the diff of blob 'p1' is unknown.*read it directly after backward"
    ):
        net.blobs["p1"].diff  # noqa: B018
    net.backward()
    check_blob(net, "p1", "diff", expected)


def interrupted_in(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch, name: str
) -> tuple[netlib.Net, dict[str, Arrays]]:
    """The paper's network after a pass and one that was interrupted in forward of a layer, and
    what a complete one computes.
    """
    net = net_of(PAPER)
    everything(net, batch(3, seed=1))
    with monkeypatch.context() as patch:
        patch.setattr(type(net.layer_dict[name]), "forward", interrupt)
        with pytest.raises(KeyboardInterrupt):
            net.forward(**batch(3))
    return net, expected_of(net_of, batch(3))


def test_a_pass_that_fails_in_a_slice_leaves_unknown_blobs(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An access is an error. A part that computes them, or the next pass, makes them known."""
    net, expected = interrupted_in(net_of, monkeypatch, "p1")
    with pytest.raises(
        NetlibError, match="the data of blob 'c2' is unknown: the last pass did not complete"
    ):
        net.blobs["c2"].data  # noqa: B018
    net.forward(end="p1")
    check_blob(net, "p1", "data", expected)
    with pytest.raises(NetlibError, match="the data of blob 'p2' is unknown"):
        net.blobs["p2"].data  # noqa: B018
    net.forward()
    check_blob(net, "p2", "data", expected)


def test_a_pass_that_fails_after_the_slices(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blobs of layers that have run have the new values, as in Caffe."""
    net, expected = interrupted_in(net_of, monkeypatch, "fc")
    check_blob(net, "c1", "data", expected)


def test_diffs_stay_unknown_if_the_next_backward_fails_before(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch
) -> None:
    net = net_of(PAPER)
    everything(net, batch(3))
    feed(net, batch(3, seed=1))
    assert net.blobs["c1"].data.any()

    monkeypatch.setattr(net.layer_dict["fc"], "backward", interrupt)
    with pytest.raises(KeyboardInterrupt):
        net.backward()
    for name in UNSTORED:
        with pytest.raises(NetlibError, match=f"the diff of blob {name!r} is unknown"):
            net.blobs[name].diff  # noqa: B018


@pytest.mark.parametrize("is_interrupted", [False, True])
def test_diffs_are_unknown_after_numbers_of_items_differ(
    net_of: MakeNet, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, is_interrupted: bool
) -> None:
    """The layers run on the whole batch from then on; the diffs before are not stored."""
    more = CONV % {"top": "cz", "bottom": "cy"}
    net = net_of(TWO_SIZES % (OF_X + OF_Y + more), netlib.TRAIN)
    x, y = rng.normal(size=(2, 4, 1, 8, 8))
    net.forward(x=x, y=y, s=np.ones(4))
    net.backward()
    net.forward()
    assert "cy" in unstored(net)
    some = np.array([1, 0, 0, 1])
    if is_interrupted:
        monkeypatch.setattr(SlicedStep, "forward", interrupt)
        with pytest.raises(KeyboardInterrupt):
            net.forward(s=some)
    else:
        net.forward(s=some)
    assert unstored(net) == []
    with pytest.raises(NetlibError, match="the diff of blob 'cy' is unknown"):
        net.blobs["cy"].diff  # noqa: B018
