"""How averages of gradients go on while layers run backwards; test_mpi.py takes them between real ranks."""

from __future__ import annotations

import numpy as np
import pytest

from netlib.blob import Blob
from netlib.distributed.allreduce import POLL_S, Averaging, Means


class Wire:
    """A communicator of one rank, and what waits for it: each request needs so many looks, a wait without end none."""

    def __init__(self, looks: int) -> None:
        self.looks = self.left = looks
        self.said: list[str] = []

    def Get_size(self) -> int:
        return 1

    def Ialltoall(self, sent: np.ndarray, received: np.ndarray) -> str:
        received[...] = 4 * sent  # as other ranks might change it
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
    """Three parts, with ones."""
    made = [[Blob((2, 3))], [Blob((4,)), Blob(())], [Blob((5,))]]
    for blob in (blob for part in made for blob in part):
        blob.diff[...] = 1
    return made


def values(made: list[list[Blob]]) -> list[float]:
    return [float(blob.diff.mean()) for part in made for blob in part]


@pytest.mark.parametrize("looks", [1, 2, 5])
def test_a_part_begins_when_it_is_complete(looks: int) -> None:
    """Not before; rounds one after the other; and the last round is looked after, too."""
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
    assert values(made) == [4, 1, 1, 1]  # the second is taken back with the third, or at the end
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
    """For arrays of these shapes, before the first step."""
    wire = Wire(1)
    means = Means(wire, wire.wait)
    arrays = [np.ones((2, 3), np.float32), np.ones(4, np.float32)]
    first = means.buffers(arrays)
    means.average(arrays)
    assert means.buffers([array.copy() for array in arrays]) is first
    assert means.buffers([array.astype(np.float64) for array in arrays]) is not first
    assert [place.shape for place in first.places] == [(2, 3), (4,)] and first.flat.size == 10
