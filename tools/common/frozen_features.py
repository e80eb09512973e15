"""Training behind frozen layers: what they compute is computed once for each picture,
not in each step.

The features are the blobs between the last layer that computes the same for a picture in each step
and the first layer that trains, draws random numbers, or normalizes by the statistics of its batch.
The training net reads them in the place of running the layers before, in the order in which its
ImageData layer would read the pictures.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import netlib
from layers.data.image_data import ImageData
from netlib.engine import Connection
from netlib.layer import Layer
from netlib.net import Net
from netlib.proto import schema
from netlib.solver import Solver
from netlib.system import memory
from tools.common.net_images import Preprocessing, passes

DRAWING = {"Dropout", "DummyData", "HandAugment", "Python"}  # types that may draw random numbers
SHARE_OF_MEMORY = 0.25  # that features may take

Arrays = dict[str, NDArray[Any]]


class NotFrozenError(Exception):
    """The reason why features cannot be computed once."""


@dataclass(frozen=True)
class Features:
    """The features of all items of a net's ImageData layer.

    reader  the layer
    first   number of the first layer that runs
    blobs   the blobs that are read from ``first`` on -> name in ``values``; "" for labels
    values  features of each item, (items, ...)
    """

    reader: ImageData
    first: int
    blobs: Mapping[str, str]
    values: Arrays

    def load(self, net: Net) -> None:
        """Write the blobs of the next batch."""
        rows, items = np.transpose(self.reader.skip_batch())
        labels = np.array([label for _, label in self.reader.items])
        for name, source in self.blobs.items():
            net.blobs[name].data[rows] = self.values[source][items] if source else labels[items]


class HeadNet(Net):
    """A net that runs the layers behind its features, if it has some."""

    features: Features | None = None

    def run_forward(self, first: int = 0, last: int | None = None) -> float:
        """Run the layers of this range; by default those behind the features."""
        if self.features is None or (first, last) != (0, None):
            return super().run_forward(first, last)
        self.features.load(self)
        return super().run_forward(self.features.first)

    def run_backward(self, first: int = 0, last: int | None = None) -> None:
        """Run the layers of this range backwards; by default those behind the features."""
        if self.features is not None and (first, last) == (0, None):
            first = self.features.first
        super().run_backward(first, last)


class HeadSolver(Solver):
    """A solver whose nets may have features.

    first_layer  name of the first layer that runs in each step
    on_test      called with the means of each test
    """

    net_class = HeadNet
    first_layer = ""
    on_test: Callable[[Mapping[str, Any]], object] | None = None

    def test(self, number: int) -> dict[str, Any]:
        """Run one test net, and report the means of its outputs."""
        means = super().test(number)
        if self.on_test is not None:
            self.on_test(means)
        return means


def use_features(solver: HeadSolver, old: Net, how: Preprocessing) -> float:
    """Compute the features of all pictures of a training and its test; returns the
    seconds that it took.

    ``old`` is the deploy net with the weights. Raises NotFrozenError with the reason if they are
    not the same in each step.
    """
    begun = time.perf_counter()
    nets = [net for net in (solver.net, *solver.test_nets) if isinstance(net, HeadNet)]
    name = _first_moving(solver.net)
    made = _made_before(old, name)
    found = [_features(net, name, made, how) for net in nets]
    for net, features in zip(nets, found):
        net.features = features
    solver.first_layer = name
    return time.perf_counter() - begun


def _features(net: Net, name: str, made: Net, how: Preprocessing) -> Features:
    """The features of a net's pictures, which the net ``made`` computes, before a layer.

    Raises NotFrozenError.
    """
    reader = _reader(net)
    first = [layer.name for layer in net.layers].index(name)
    blobs = _blobs_between(net.connections, first, reader)
    paths = [path for path, _ in reader.items]
    return Features(reader, first, blobs, _computed(made, paths, how, set(blobs.values()) - {""}))


def _reader(net: Net) -> ImageData:
    """The layer that reads the pictures. Raises NotFrozenError if it draws random numbers."""
    reader = net.layers[0]
    assert isinstance(reader, ImageData)
    if reader.transformer.param.mirror:
        raise NotFrozenError("pictures are mirrored at random (--mirror)")
    p = reader.param
    crop = reader.transformer.param.crop_size
    if net.state.phase == "TRAIN" and crop and (p.new_height, p.new_width) != (crop, crop):
        raise NotFrozenError(
            "pictures are cropped at random, as the mean image is larger than the input (--mean-file)"
        )
    return reader


def _first_moving(net: Net) -> str:
    """The first layer whose values of a picture may differ in each step.

    Raises NotFrozenError if none is before it.
    """
    trained = {param.layer for param in net.learnable if param.spec.lr_mult != 0}
    for number, layer in enumerate(net.layers):
        if layer.name in trained or layer.type in DRAWING or _is_by_batch(layer):
            if not any(before.blobs for before in net.layers[:number]):
                raise NotFrozenError(f"no frozen layer with weights is before layer {layer.name!r}")
            return layer.name
    raise NotFrozenError("no layer is trained")


def _is_by_batch(layer: Layer) -> bool:
    """Whether a layer normalizes by the statistics of its batch."""
    given: Any = layer
    return (layer.type == "BatchNorm" and not given.uses_sums) or (
        layer.type == "BN" and given.of_batch
    )


def _made_before(old: Net, name: str) -> Net:
    """The layers of the deploy net before the one of this name, or before the one that a new
    layer replaces.
    """
    names = [layer.name for layer in old.layers]
    heads = [i for i, layer in enumerate(old.layers) if layer.blobs]
    end = names.index(name) if name in names else heads[-1]
    specs = tuple(layer.spec for layer in old.layers[:end])
    made = Net(schema.changed(old.param, layer=specs), netlib.TEST, engine=old.engine.name)
    made.copy_from(old)
    return made


def _blobs_between(
    connections: Sequence[Connection], first: int, reader: ImageData
) -> dict[str, str]:
    """The blobs that are made before a layer and read from it on, with the blobs that they
    are copies of.
    """
    label = reader.spec.top[1]
    origins: dict[str, str] = {}
    for at in connections[:first]:
        spec = at.layer.spec
        if at.layer.type == "Split" and spec.bottom[0] == label:
            origins.update(dict.fromkeys(spec.top, label))
        else:
            origins.update((name, name) for name in spec.top)
    read = dict.fromkeys(name for at in connections[first:] for name in at.layer.spec.bottom)
    return {
        name: "" if origins[name] == label else origins[name] for name in read if name in origins
    }


def _computed(net: Net, paths: Sequence[str], how: Preprocessing, names: set[str]) -> Arrays:
    """The blobs of a net for each picture. Raises NotFrozenError if they take too much memory."""
    batch = net.blobs[net.inputs[0]].shape[0]
    bytes_of_item = sum(net.blobs[name].bytes for name in names) // batch
    if (size := bytes_of_item * len(paths)) > SHARE_OF_MEMORY * memory.physical():
        raise NotFrozenError(
            f"the features of {len(paths)} pictures would take {memory.format_bytes(size)}"
        )
    parts: dict[str, list[NDArray[Any]]] = {name: [] for name in names}
    for _, _, arrays in passes(net, paths, how, sorted(names)):
        for name, found in parts.items():
            found.append(arrays[name].copy())
    return {name: np.concatenate(found) for name, found in parts.items()}
