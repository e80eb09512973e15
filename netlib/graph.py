"""Graph: layers connected by blobs, in the order of the file.

Determines which layer writes and reads each blob, which parameters are shared, which tops are
losses, and which layers run backwards.
"""

from __future__ import annotations

import logging
from collections.abc import Set
from typing import Any

import numpy as np

from netlib.blob import Blob, Blobs
from netlib.building import create, python_layer
from netlib.building.blob_errors import taken_top, unknown_bottom
from netlib.building.params import Parameters
from netlib.engine import Connection, Engine
from netlib.layer import Layer, check_backward
from netlib.layer_errors import LayerErrors
from netlib.proto import schema
from netlib.proto.messages import LayerParameter, NetParameter, NetState
from netlib.proto.net_parameter import distinct, insert_splits

log = logging.getLogger("netlib")
AUTOMATIC = "(automatic)"  # Caffe's name for the unnamed top of a loss layer


class LayerHook:
    """Callbacks for each layer while a graph is built; a subclass overrides them."""

    def before_setup(self, layer: Layer) -> None:
        """Called when the layer exists but has not read its options."""

    def after_setup(self, layer: Layer, seed: np.random.SeedSequence) -> None:
        """Called when the layer has its parameters and tops; ``seed`` is the seed of its
        random generator.
        """


class Graph:
    """The connected layers of a net.

    ``param`` holds the layers of one phase only. ``seed`` seeds their random generators; None means
    a new seed each run. The attributes are documented in net.py. Raises LayerError.
    """

    source: str  # the file, for messages
    state: NetState
    excluded: Set[str]  # tops of the layers that ``state`` excludes, for messages

    def __init__(
        self,
        param: NetParameter,
        phase: schema.Phase,
        engine: Engine,
        dtype: np.dtype[Any],
        seed: int | None = None,
        layer_hook: LayerHook | None = None,
    ) -> None:
        self.name, self._phase, self.engine, self.dtype = param.name, phase, engine, dtype
        self.layer_hook = layer_hook or LayerHook()
        self.blobs: dict[str, Blob] = {}
        self.params: dict[str, Blobs] = {}
        self.layer_dict: dict[str, Layer] = {}
        self.connections: list[Connection] = []
        self.losses: list[tuple[Blob, float, str]] = []
        self.inputs: list[str] = []
        self.parameters = Parameters()
        self._writers: dict[str, str] = {}  # blob name -> layer that created it
        self._unread: dict[str, None] = {}  # names of blobs that no layer has read yet
        self._needs: dict[Blob, bool] = {}  # whether a layer towards the data needs its gradient
        specs = insert_splits(param.layer)
        seeds = np.random.SeedSequence(seed).spawn(len(specs))
        # options can be any numbers; a run reports values that are not finite
        with np.errstate(all="ignore"):
            for spec, name, own_seed in zip(specs, distinct([spec.name for spec in specs]), seeds):
                self._add(spec, name, own_seed)
        self.layers = list(self.layer_dict.values())
        self.learnable = self.parameters.learnable
        self.outputs = sorted(self._unread)  # Caffe's order
        self._decide_backward(param.force_backward)
        if phase == "TRAIN":
            for at in self.connections:
                if at.needs_backward:
                    check_backward(at.layer, at.propagate_down)
        self._note_overwritten_tops()

    # ------------------------------------------------------------------------------- layer by layer

    def _add(self, spec: LayerParameter, name: str, seed: np.random.SeedSequence) -> None:
        """Create a layer and its tops; its bottoms exist already."""
        rng = np.random.Generator(np.random.SFC64(seed))
        layer = create.create(
            spec, spec.phase or self._phase, rng, self.dtype, self.engine.implementation
        )
        layer.name = name
        _check_counts(layer)
        bottom = self._bottoms(layer)
        top = self._tops(layer)
        layer.blobs.bytes_before = self.parameters.bytes
        self.layer_hook.before_setup(layer)
        with LayerErrors(layer, bottom):
            layer.setup(bottom, top)
            layer.reshape(bottom, top)
        if spec.type == "Python":
            python_layer.check_attributes(layer, spec, name)
        for note in getattr(layer, "notes", ()):
            log.info("%s: %s", name, note)
        self._connect(layer, bottom, top)
        self._weigh(layer, top)
        self.layer_dict[name] = layer
        if layer.blobs:
            self.params[name] = layer.blobs
            if name != spec.name:
                log.warning(
                    "%s: a second layer is called %r; its parameters are those of %r here, in Caffe those "
                    "of the first are loaded twice",
                    schema.position_of(spec),
                    spec.name,
                    name,
                )
        self.layer_hook.after_setup(layer, seed)

    def _connect(self, layer: Layer, bottom: Blobs, top: Blobs) -> None:
        """Register the layer and its parameters.

        It runs backwards if it, or a layer before it, is trained.
        """
        trains = any(p.spec.lr_mult != 0 for p in self.parameters.enter(layer))
        down = _propagate_down(layer, [self._needs.get(blob, False) for blob in bottom])
        at = Connection(layer, bottom, top, down, any(down) or trains)
        for blob in top:
            self._needs[blob] = self._needs.get(blob, False) or at.needs_backward
        self.connections.append(at)

    def _bottoms(self, layer: Layer) -> Blobs:
        """The bottom blobs of the layer, created by layers before it."""
        for index, name in enumerate(layer.spec.bottom):
            if name not in self.blobs:
                raise unknown_bottom(layer, index, self.blobs, self.excluded, self.state)
            self._unread.pop(name, None)
        return Blobs(self.blobs[name] for name in layer.spec.bottom)

    def _tops(self, layer: Layer) -> Blobs:
        """The top blobs of the layer: new blobs, or the bottom of the same index for a
        layer in place.
        """
        tops = Blobs(self._top(layer, index) for index in range(len(layer.spec.top)))
        tops += [self.engine.blob(self.dtype) for _ in range(_automatic_tops(layer))]
        self._unread.update(dict.fromkeys(layer.spec.top))
        return tops

    def _top(self, layer: Layer, index: int) -> Blob:
        name = layer.spec.top[index]
        bottom = layer.spec.bottom[index : index + 1]
        if name in self.blobs and name not in bottom:
            writers = [self.layer_dict[self._writers[blob]].spec for blob in bottom]
            raise taken_top(layer, index, self._writers[name], writers)
        if name not in self.blobs:
            self.blobs[name] = self.engine.blob(self.dtype)
            self._writers[name] = layer.name
            if layer.is_input:
                self.inputs.append(name)
        return self.blobs[name]

    def _weigh(self, layer: Layer, top: Blobs) -> None:
        """Register the losses of the layer."""
        given = layer.spec.loss_weight
        if given and len(given) != len(top):
            raise layer.fail(f"has {len(top)} tops, but {len(given)} loss_weight")
        names = [*layer.spec.top, *[AUTOMATIC] * len(top)]
        for blob, weight, name in zip(top, given or [layer.default_loss_weight], names):
            if weight:
                self.losses.append((blob, weight, name))

    # ------------------------------------------------------------------------------------ gradients

    def _decide_backward(self, force: bool) -> None:
        """Apply Caffe's rules: a gradient is computed only between a trained parameter and a loss.

        Each blob has one reader at this point (``insert_splits``); layers in place
        count as a chain.
        """
        under_loss = {blob for blob, _, _ in self.losses}
        skipped = set()
        for at in reversed(self.connections):
            contributes = any(t in under_loss for t in at.top)
            wanted = any(t not in skipped for t in at.top)
            if not (contributes and wanted):
                at.needs_backward = False
                at.propagate_down = [False] * len(at.bottom)
            for blob, down in zip(at.bottom, at.propagate_down):
                if contributes:
                    under_loss.add(blob)
                if not down:
                    skipped.add(blob)
        if force:
            for at in self.connections:
                at.needs_backward = True
                at.propagate_down = [
                    down or at.layer.allow_force_backward(i)
                    for i, down in enumerate(at.propagate_down)
                ]

    def _note_overwritten_tops(self) -> None:
        """Warn where a gradient will be wrong because its top is overwritten; Caffe computes it
        without a warning.
        """
        writers: dict[Blob, Connection] = {}
        for at in self.connections:
            for blob, name in zip(at.top, at.layer.spec.top):
                below = writers.get(blob)
                if below is not None and below.needs_backward:
                    _warn_of_overwritten(below.layer, at.layer, name)
                if below is None or not (below.layer.reads_signs and at.layer.keeps_signs):
                    writers[blob] = at


def _warn_of_overwritten(below: Layer, layer: Layer, name: str) -> None:
    """Warn if a layer overwrites a top of ``below`` that its gradient needs."""
    if below.reads_top:
        needs = "which the gradient of layer %r needs: it"
    elif below.reads_signs and not layer.keeps_signs:
        needs = "of which the gradient of layer %r needs the signs: where they change it"
    else:
        return
    log.warning(
        f"%s: layer %r overwrites blob %r, {needs} will be wrong, as in Caffe; give the top another name",
        schema.position_of(layer.spec),
        layer.name,
        name,
        below.name,
    )


def _automatic_tops(layer: Layer) -> int:
    """Number of unnamed tops that a loss layer has."""
    return max(0, layer.tops[0] - len(layer.spec.top)) if layer.default_loss_weight else 0


def _propagate_down(layer: Layer, wanted: list[bool]) -> list[bool]:
    """Bottoms that receive a gradient: as the prototxt says, by default those that need one.

    Raises LayerError.
    """
    given = list(layer.spec.propagate_down)
    if given and len(given) != len(wanted):
        raise layer.fail(f"has {len(wanted)} bottoms, but {len(given)} propagate_down")
    return given or wanted


def _check_counts(layer: Layer) -> None:
    """Check the numbers of bottoms and tops against those of the layer type. Raises LayerError."""
    for what, names, (least, most) in (
        ("bottom", layer.spec.bottom, layer.bottoms),
        ("top", layer.spec.top, layer.tops),
    ):
        given = len(names) + (_automatic_tops(layer) if what == "top" else 0)
        if given < least or (most is not None and len(names) > most):
            wanted = f"{least} to {most}"
            if most is None:
                wanted = f"at least {least}"
            elif most == least:
                wanted = f"{least}"
            raise layer.fail(f"has {len(names)} {what}s, {layer.type} takes {wanted}")
    if not layer.in_place:
        for name in set(layer.spec.bottom) & set(layer.spec.top):
            raise layer.fail(
                f"{layer.type} cannot run in place, but {name!r} is both bottom and top"
            )
