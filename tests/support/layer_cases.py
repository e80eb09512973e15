"""A small example of every layer type, for tests that hold for all of them: ``layer_cases.txt``.

A bottom is an array in JSON, or a shape of random values, which are away from 0: ``Nx3``. A word
before the shape asks for others:

to3         up to 3, not 1
positive    positive
different   far apart from each other
below3      whole numbers, 0 to 2
alternate   1 and 0 in turn
boxes       the same box, everywhere
places      six different numbers below 18 in each of two channels
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from netlib import gradcheck
from netlib.blob import Blob, Blobs
from netlib.layer import Layer
from netlib.proto.schema import Phase
from tests.support.nets import inputs
from tests.support.tables import lines_of, shape_of

RNG = np.random.default_rng(0)


def off_zero(*shape: int) -> np.ndarray:
    """Return random numbers away from 0."""
    return RNG.choice([-1.0, 1.0], shape) * RNG.uniform(0.2, 1, shape)


def different(*shape: int) -> np.ndarray:
    """Return numbers far apart from each other."""
    return RNG.permutation(int(np.prod(shape))).reshape(shape) / 7.0


def places(N: int, *item: int) -> np.ndarray:
    return np.reshape([RNG.permutation(18)[:6] for _ in range(2 * N)], (N, *item))


MAKERS: dict[str, Callable[..., np.ndarray]] = {  # of the number in the word, and the shape
    "to": lambda most, *shape: most * off_zero(*shape),
    "positive": lambda _, *shape: abs(off_zero(*shape)),
    "different": lambda _, *shape: different(*shape),
    "below": lambda most, *shape: RNG.integers(0, most, shape),
    "alternate": lambda _, N: np.arange(N) % 2 == 0,
    "boxes": lambda _, *shape: np.resize([0.1, 0.2, 0.5, 0.9], shape),
    "places": lambda _, *shape: places(*shape),
}


def array_of(word: str) -> np.ndarray:
    """Return a new array of a word of the table."""
    if word[0] == "[":
        return np.array(json.loads(word))
    made, _, shape = word.rpartition(":")
    maker = made.rstrip("0123456789")
    return MAKERS[maker or "to"](int(made[len(maker) :] or 1), *shape_of(shape))


@dataclass(frozen=True)
class Case:
    """A row of the table: a layer, with the bottoms whose gradient is ``wanted``."""

    kind: str
    options: str
    words: list[str]
    wanted: list[bool]
    tops: int
    phase: Phase

    def bottoms(self, N: int) -> list[np.ndarray]:
        """Return new bottoms for N items."""
        counted = [word.replace("N-1", str(N - 1)).replace("N", str(N)) for word in self.words]
        return [array_of(word) for word in counted]

    def layer(self, arrays: list[np.ndarray]) -> Layer:
        """Return a new layer for such bottoms; all of them have the same parameters."""
        text = f'type: "{self.kind}" {self.options}'
        return gradcheck.make_layer(text, arrays, self.tops, self.phase)

    def check(self, layer: Layer, arrays: list[np.ndarray], in_place: bool = False) -> None:
        """Compare its gradients with differences."""
        gradcheck.check(layer, arrays, self.tops, self.wanted, in_place=in_place)

    def net_text(self, arrays: list[Any]) -> str:
        """Return a net with inputs x0, x1 ... of these arrays, and the layer, with tops y0 ..."""
        shapes = {f"x{i}": np.shape(array) for i, array in enumerate(arrays)}
        bottoms = "".join(f'bottom: "{blob}" ' for blob in shapes)
        tops = "".join(f'top: "y{i}" ' for i in range(self.tops))
        layer = f'name: "it" type: "{self.kind}" {bottoms} {tops} {self.options}'
        return f"{inputs(**shapes)} layer {{ {layer} }}"


def case_of(
    layer: str, bottoms: str, gradients: str = "", tops: str = "1", phase: str = "TRAIN"
) -> Case:
    """Return the case of a row."""
    kind, _, options = layer.partition(" ")
    words = bottoms.split()
    wanted = [not gradients or str(i) in gradients.split() for i in range(len(words))]
    return Case(kind, options, words, wanted, int(tops), cast("Phase", phase))


def cases_in(table: Path) -> dict[str, Case]:
    """Return the cases of a table by their rows."""
    return {" ".join(row): case_of(*row) for row in lines_of(table)}


CASES = {case.kind: case for case in cases_in(Path(__file__).with_suffix(".txt")).values()}
# Types without bottoms, or with a file that is written once, are covered by their own tests.
SOURCES = {
    "Data",
    "DummyData",
    "HDF5Data",
    "HDF5Output",
    "ImageData",
    "Input",
    "MemoryData",
    "Parameter",
}


def forward(
    case: Case, layer: Layer, arrays: list[np.ndarray], in_place: bool = False
) -> tuple[Blobs, Blobs]:
    """Run the layer forward, and return its bottoms and tops: new blobs, or the bottoms.

    The next run draws the same random numbers.
    """
    bottom = Blobs([Blob(np.shape(x), np.float64) for x in arrays])
    for blob, x in zip(bottom, arrays):
        blob.data[...] = x
    new = [Blob((), np.float64) for _ in range(case.tops)]
    top = Blobs(bottom[: case.tops] if in_place else new)
    start = layer.state()
    layer.reshape(bottom, top)
    layer.forward(bottom, top)
    layer.restore(start)
    return bottom, top
