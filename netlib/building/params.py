"""The learnable parameters of a net. Parameters with the same name are shared.

The first layer that names a parameter owns it; the others share its memory. ``lr_mult`` and
``decay_mult`` can be set in any of these layers but must agree.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from netlib.blob import Blob
from netlib.layer import Layer
from netlib.proto import schema
from netlib.proto.messages import ParamSpec


@dataclass
class Param:
    """One learnable parameter of a net."""

    blob: Blob
    layer: str  # the layer that owns it
    index: int  # among that layer's parameters
    spec: ParamSpec
    given: dict[str, str] = field(default_factory=dict)  # multiplier -> the layer that sets it

    @property
    def label(self) -> str:
        """``layer/index``."""
        return f"{self.layer}/{self.index}"


class Parameters:
    """The ``learnable`` parameters, in the order of their layers, and the total size of their
    values in ``bytes``.
    """

    def __init__(self) -> None:
        self.learnable: list[Param] = []
        self.bytes = 0
        # layer, index, parameter, and the shape with which the layer computes
        self._made: list[tuple[Layer, int, Blob, tuple[int, ...]]] = []
        self._named: dict[str | None, Param] = {}

    def enter(self, layer: Layer) -> list[Param]:
        """Register the parameters of a layer and return them, or their owners if shared.

        Raises LayerError.
        """
        if len(layer.spec.param) > len(layer.blobs):
            raise layer.fail(
                f"has {len(layer.blobs)} parameters, but {len(layer.spec.param)} param blocks"
            )
        entered = []
        for i, blob in enumerate(layer.blobs):
            spec = layer.spec.param[i] if i < len(layer.spec.param) else ParamSpec()
            owner = self._named.get(spec.name)
            if owner is not None:
                _share(layer, i, spec, owner)
            else:
                owner = Param(blob, layer.name, i, spec)
                self.learnable.append(owner)
                self.bytes += blob.bytes
                if spec.name:
                    self._named[spec.name] = owner
            _merge_multipliers(layer, spec, owner)
            entered.append(owner)
            if layer.type != "Python":  # which may reshape its own
                self._made.append((layer, i, blob, blob.shape))
        return entered

    @contextmanager
    def own_shapes(self) -> Iterator[None]:
        """Context manager of a pass, in which parameters that a caller reshaped have the shapes of
        their layers: as in Caffe, a layer reads the values in its own order.

        Raises LayerError if their number is another one.
        """
        given = []
        for layer, i, blob, shape in self._made:
            if blob.shape == shape:
                continue
            if blob.count != math.prod(shape):
                raise layer.fail(
                    f"parameter {i} was reshaped to {blob.shape}, but the layer computes with {shape}; "
                    "reshape it back, or change the options of the layer and build the net again"
                )
            given.append((blob, blob.shape, shape))
        for blob, _, shape in given:
            blob.reshape(shape)
        try:
            yield
        finally:
            for blob, shape, _ in given:
                blob.reshape(shape)


def _share(layer: Layer, index: int, spec: ParamSpec, owner: Param) -> None:
    """Let parameter ``index`` of a layer share the memory of its owner.

    Raises LayerError if the shapes differ; with share_mode PERMISSIVE, if the counts do.
    """
    blob = layer.blobs[index]
    mine, theirs = blob.shape, owner.blob.shape
    may_differ = spec.share_mode == "PERMISSIVE" and blob.count == owner.blob.count
    if mine != theirs and not may_differ:
        raise layer.fail(
            f"parameter {index} {mine} cannot share {spec.name!r} with layer {owner.layer!r} "
            f"parameter {owner.index} {theirs}"
        )
    blob.share(owner.blob)


def _merge_multipliers(layer: Layer, spec: ParamSpec, owner: Param) -> None:
    """Apply the multipliers that this layer sets.

    Raises LayerError if another layer set a different value.
    """
    for name in ("lr_mult", "decay_mult"):
        if not schema.is_set(spec, name):
            continue
        mine, theirs = getattr(spec, name), getattr(owner.spec, name)
        if name in owner.given and mine != theirs:
            raise layer.fail(
                f"shared parameter {spec.name!r} has {name} {mine:g}, but {theirs:g} in layer {owner.given[name]!r}"
            )
        owner.spec = schema.changed(owner.spec, **{name: mine})
        owner.given.setdefault(name, layer.name)
