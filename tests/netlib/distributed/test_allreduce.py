"""Gradients are averaged while layers run backwards; test_mpi.py does so between real ranks."""

from __future__ import annotations

import numpy as np
import pytest

import netlib
from netlib.blob import Blob
from netlib.distributed.allreduce import POLL_S, Averaging, Gradients, Means
from netlib.proto import prototxt
from tests.support.nets import inputs

pytestmark = pytest.mark.both_engines

FIXED = "param { lr_mult: 0 } param { lr_mult: 0 }"
SHARED = 'param { name: "w" } param { name: "b" }'


class Wire:
    """A communicator of one rank: each request needs a number of polls, a blocking wait needs one."""

    def __init__(self, looks: int) -> None:
        self.looks = self.left = looks
        self.said: list[str] = []

    def Get_size(self) -> int:
        return 1

    def Ialltoall(self, sent: np.ndarray, received: np.ndarray) -> str:
        received[...] = 4 * sent  # stands for the sum over other ranks
        return self._begin("sent")

    def Iallgather(self, sent: np.ndarray, received: np.ndarray) -> str:
        received[...] = sent
        return self._begin("gathered")

    def _begin(self, what: str) -> str:
        self.left = self.looks
        self.said.append(what)
        return what

    def wait(self, requests: list[str], seconds: float | None = None) -> bool:
        if not requests:
            return True
        self.said.append("look" if seconds else "wait")
        assert seconds in (None, POLL_S)
        self.left -= 1
        return seconds is None or self.left <= 0


def parts() -> list[list[Blob]]:
    """Three parts of blobs with diffs of one."""
    made = [[Blob((2, 3))], [Blob((4,)), Blob(())], [Blob((5,))]]
    for blob in (blob for part in made for blob in part):
        blob.diff[...] = 1
    return made


def values(made: list[list[Blob]]) -> list[float]:
    return [float(blob.diff.mean()) for part in made for blob in part]


@pytest.mark.parametrize("looks", [1, 2, 5])
def test_a_part_begins_when_it_is_complete(looks: int) -> None:
    """A part starts once it is complete, rounds run one after the other, and finish completes the last one."""
    wire, made = Wire(looks), parts()
    under_way = Averaging(Means(wire, wire.wait), made)
    under_way.poll()
    under_way.poll(0)
    assert wire.said == []
    for _ in range(20):
        under_way.poll(1)
    assert wire.said[: 2 * looks + 2] == ["sent", *["look"] * looks, "gathered", *["look"] * looks]
    assert set(wire.said[2 * looks + 2 :]) <= {"look"}
    for _ in range(20):
        under_way.poll(2)
    assert values(made) == [4, 1, 1, 1]  # the second result is copied back with the third part or by finish
    assert [word for word in wire.said if word != "look"] == ["sent", "gathered"] * 2
    under_way.finish()
    assert [word for word in wire.said if word != "look"][4:] == ["wait", "sent", "wait", "gathered", "wait"]
    assert values(made) == [4, 4, 4, 4]


def test_nobody_looked() -> None:
    wire, made = Wire(1), parts()
    Averaging(Means(wire, wire.wait), made).finish()
    assert wire.said == ["sent", "wait", "gathered", "wait"] * 3 and values(made) == [4, 4, 4, 4]
    Averaging(Means(wire, wire.wait), []).finish()


def test_buffers_are_made_once() -> None:
    """Buffers are allocated once for arrays of the same shapes and types."""
    wire = Wire(1)
    means = Means(wire, wire.wait)
    arrays = [np.ones((2, 3), np.float32), np.ones(4, np.float32)]
    first = means.buffers(arrays)
    means.average(arrays)
    assert means.buffers([array.copy() for array in arrays]) is first
    assert means.buffers([array.astype(np.float64) for array in arrays]) is not first
    assert [place.shape for place in first.places] == [(2, 3), (4,)] and first.flat.size == 10


def net_of(*params: str) -> netlib.Net:
    """A net of inner products fc0, fc1, ... with these ``param`` blocks."""
    text = inputs(x0=(2, 4))
    for i, param in enumerate(params):
        text += f"""layer {{ name: "fc{i}" type: "InnerProduct" bottom: "x{i}" top: "x{i + 1}" {param}
                      inner_product_param {{ num_output: 4 weight_filler {{ type: "xavier" }} }} }}"""
    text += f'layer {{ name: "sum" type: "Reduction" bottom: "x{len(params)}" top: "loss" loss_weight: 1 }}'
    return netlib.Net(prototxt.parse(text, "net.prototxt"), netlib.TRAIN)


def labels(net: netlib.Net, gradients: Gradients) -> list[list[str]]:
    of_blob = {id(param.blob): param.label for param in net.learnable}
    return [[of_blob[id(blob)] for blob in part] for part in gradients.parts]


@pytest.mark.parametrize(
    ("least", "expected"),
    [
        (1, [["fc2/1", "fc2/0"], ["fc1/1", "fc1/0"], ["fc0/1", "fc0/0"]]),
        (81, [["fc2/1", "fc2/0", "fc1/1", "fc1/0"], ["fc0/1", "fc0/0"]]),  # a layer has 80 bytes
        (2**20, [["fc2/1", "fc2/0", "fc1/1", "fc1/0", "fc0/1", "fc0/0"]]),
    ],
)
def test_parts_end_between_layers(least: int, expected: list[list[str]]) -> None:
    net = net_of("", "", "")
    gradients = Gradients(net.layers, net.learnable, least)
    assert labels(net, gradients) == expected
    done = [gradients.complete(layer) for layer in reversed(net.layers)]
    assert done[0] == 0 and done[-2:] == [len(expected)] * 2 and done == sorted(done)  # sum, fc2, ..., fc0, input


def test_fixed_and_shared_parameters() -> None:
    """Fixed parameters are in no part; a shared one is complete when the first layer that uses it has run backwards."""
    net = net_of(SHARED, "", SHARED, FIXED)
    gradients = Gradients(net.layers, net.learnable, min_bytes=1)
    assert labels(net, gradients) == [["fc1/1", "fc1/0"], ["fc0/1", "fc0/0"]]
    assert [gradients.complete(net.layer_dict[f"fc{i}"]) for i in (3, 2, 1, 0)] == [0, 0, 1, 2]


def test_the_papers_network() -> None:
    """The large gradients are complete before the backward passes of the convolutions, which take most of the time."""
    net = netlib.Net("prototxt/nyu_deploy.prototxt", netlib.TRAIN)
    gradients = Gradients(net.layers, net.learnable)
    assert [part[-1] for part in labels(net, gradients)] == ["FC2/0", "FC1/0", "convL1/0"]
    assert gradients.complete(net.layer_dict["FC1"]) == 2
