"""Net: a list of layers. Build in file order, run forwards, run backwards.

The interface is pycaffe's: ``net.blobs``, ``net.params``, ``net.forward()``, ``net.backward()``, ``net.save()``.
``net.blobs[name].data`` is always true: a blob that slices.py keeps hidden is computed when somebody first looks
at it, and is stored from then on. A first look shows the last pass, as long as its inputs have not been overwritten
and, for a diff, until the next forward.
"""

from __future__ import annotations

import dataclasses
import functools
import weakref
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from netlib import layer as layers
from netlib import parallel, prototxt, schema, slices, snapshot
from netlib.blob import Blob, Blobs
from netlib.errors import LayerError, NetlibError, PrototxtError, WeightsError, did_you_mean
from netlib.layer import PHASES, Layer
from netlib.prototxt import Field, Message, Scalar
from netlib.schema import LayerParameter, NetParameter, NetState, NetStateRule, ParamSpec
from netlib.slices import Connection, SlicedRun, WholeStep
from netlib.splits import insert_splits

TRAIN, TEST = PHASES["TRAIN"], PHASES["TEST"]
_seed: int | None = None


def set_random_seed(seed: int) -> None:
    """Seed of the nets that are built from now on without one of their own."""
    global _seed
    _seed = seed


@dataclass
class Param:
    """One learnable parameter of a net."""

    blob: Blob
    layer: str  # the layer that owns it
    index: int  # among that layer's parameters
    spec: ParamSpec

    @property
    def label(self) -> str:
        """``layer/index``."""
        return f"{self.layer}/{self.index}"


class Net:
    """A net of layers.

    ``Net(model, phase)`` or ``Net(model, weights, phase)``; ``model`` is a file, or a parsed NetParameter.

    blobs           name -> Blob, in the order in which they are made
    params          layer name -> its parameters, for layers that have some
    inputs, outputs names of the blobs that come from outside, and of those that no layer reads
    layers          the layers in order; layer_dict by name
    steps           how they are run: one by one, or several on slices of the batch (slices.py)
    learnable       list of Param, shared ones once

    Raises NetlibError (PrototxtError, LayerError, WeightsError) for whatever is wrong with the files.
    """

    def __init__(
        self,
        model: str | Path | NetParameter | Message,
        *args: Any,
        phase: int | None = None,
        weights: str | Path | None = None,
        dtype: DTypeLike = np.float32,
        level: int = 0,
        stages: Sequence[str] = (),
        state: NetState | None = None,
        seed: int | None = None,
    ) -> None:
        for value in args:
            if isinstance(value, (int, np.integer)):
                phase = int(value)
            else:
                weights = value
        self.dtype = np.dtype(dtype)
        if self.dtype.kind != "f":
            raise NetlibError(f"a net computes in float32 or float64, not in {self.dtype}")
        self.source = str(model) if isinstance(model, (str, Path)) else "<net>"
        param = load_parameter(model)
        phase_name: schema.Phase = param.state.phase if phase is None else ("TRAIN", "TEST")[phase]
        self.state = state or NetState(phase_name, level or param.state.level, tuple(stages) or param.state.stage)
        self.phase = PHASES[self.state.phase]
        self.name = param.name
        self.seed = _seed if seed is None else seed
        self.param = dataclasses.replace(param, layer=tuple(select_layers(param, self.state)))
        self._build(insert_splits(self.param.layer), param.force_backward)
        self._visible: set[int] = set()
        self._by_layer = False
        self._seen = [False, False]  # has forward, has backward run
        self._plan()
        if weights is not None:
            self.copy_from(weights, strict=True)

    # ------------------------------------------------------------------------------------------ building

    def _build(self, specs: list[LayerParameter], force_backward: bool) -> None:
        self.blobs: dict[str, Blob] = {}
        self.params: dict[str, Blobs] = {}
        self.layers: list[Layer] = []
        self.learnable: list[Param] = []
        self.connections: list[Connection] = []
        self.losses: list[tuple[Blob, float, str]] = []
        self.inputs: list[str] = []
        self._writer: dict[str, str] = {}
        self._named: dict[str, Param] = {}
        seeds = np.random.SeedSequence(self.seed).spawn(len(specs))
        names: set[str] = set()
        needs: dict[int, bool] = {}  # blob id -> does somebody below want its gradient
        unread: dict[str, None] = {}
        for spec, seed in zip(specs, seeds):
            if spec.name in names:
                raise LayerError(f"{schema.position_of(spec)}: error: two layers are called {spec.name!r}")
            names.add(spec.name)
            _check_name(spec)
            rng = np.random.Generator(np.random.SFC64(seed))
            layer = layers.create(spec, spec.phase or self.state.phase, rng, self.dtype)
            self._check_counts(layer)
            bottom = Blobs(self._bottom(layer, i, name, unread) for i, name in enumerate(spec.bottom))
            top = Blobs(self._top(layer, name, unread) for name in spec.top)
            layer.guarded("setup", bottom, top)
            layer.guarded("reshape", bottom, top)
            params = self._share(layer)
            down = [needs.get(id(b), False) for b in bottom]
            if spec.propagate_down:
                if len(spec.propagate_down) != len(bottom):
                    raise layer.fail(f"has {len(bottom)} bottoms, but {len(spec.propagate_down)} propagate_down")
                down = list(spec.propagate_down)
            trains = any(p.spec.lr_mult != 0 for p in params)
            at = Connection(layer, bottom, top, down, any(down) or trains)
            for blob in top:
                needs[id(blob)] = needs.get(id(blob), False) or at.needs_backward
            self.connections.append(at)
            self.layers.append(layer)
            if layer.blobs:
                self.params[layer.name] = layer.blobs
            self._weigh(layer, top)
        self.layer_dict = {layer.name: layer for layer in self.layers}
        self.outputs = list(unread)
        self._decide_backward(force_backward)

    def _check_counts(self, layer: Layer) -> None:
        for what, names, (least, most) in (
            ("bottom", layer.spec.bottom, layer.bottoms),
            ("top", layer.spec.top, layer.tops),
        ):
            if len(names) < least or (most is not None and len(names) > most):
                wanted = f"{least}" if most == least else f"at least {least}" if most is None else f"{least} to {most}"
                raise layer.fail(f"has {len(names)} {what}s, {layer.type} takes {wanted}")
        if not layer.in_place:
            for name in set(layer.spec.bottom) & set(layer.spec.top):
                raise layer.fail(f"{layer.type} cannot run in place, but {name!r} is both bottom and top")

    def _bottom(self, layer: Layer, index: int, name: str, unread: dict[str, None]) -> Blob:
        if name not in self.blobs:
            later = did_you_mean(name, self.blobs) or (f"; known here: {', '.join(self.blobs)}" if self.blobs else "")
            where = schema.position_of(layer.spec, "bottom", index)
            raise LayerError(f"{where}: error: layer {layer.name!r}: unknown bottom blob {name!r}{later}")
        unread.pop(name, None)
        return self.blobs[name]

    def _top(self, layer: Layer, name: str, unread: dict[str, None]) -> Blob:
        if name in self.blobs and name not in layer.spec.bottom:
            raise layer.fail(
                f"top blob {name!r} is already written by layer {self._writer[name]!r}; "
                "give it another name, or the same one as the bottom to run in place"
            )
        if name not in self.blobs:
            self.blobs[name] = Blob((), self.dtype)
            self._writer[name] = layer.name
            if layer.is_input:
                self.inputs.append(name)
        unread[name] = None
        return self.blobs[name]

    def _share(self, layer: Layer) -> list[Param]:
        """Enter the layer's parameters; a name seen before makes two of them one. Returns them, or their owners."""
        if len(layer.spec.param) > len(layer.blobs):
            raise layer.fail(f"has {len(layer.blobs)} parameters, but {len(layer.spec.param)} param blocks")
        entered = []
        for i, blob in enumerate(layer.blobs):
            spec = layer.spec.param[i] if i < len(layer.spec.param) else ParamSpec()
            owner = self._named.get(spec.name or "")
            if owner is None:
                entered.append(Param(blob, layer.name, i, spec))
                self.learnable.append(entered[-1])
                if spec.name:
                    self._named[spec.name] = entered[-1]
            else:
                self._check_sharing(layer, i, blob, spec, owner)
                owner.blob.lazily_cleared &= blob.lazily_cleared
                blob.share(owner.blob)
                entered.append(owner)
        return entered

    def _check_sharing(self, layer: Layer, i: int, blob: Blob, spec: ParamSpec, owner: Param) -> None:
        same = blob.count == owner.blob.count if spec.share_mode == "PERMISSIVE" else blob.shape == owner.blob.shape
        if not same:
            raise layer.fail(
                f"parameter {i} {blob.shape} cannot share {spec.name!r} with layer {owner.layer!r} "
                f"parameter {owner.index} {owner.blob.shape}"
            )
        for name in ("lr_mult", "decay_mult"):
            if not _gives(spec, name):
                continue
            mine, theirs = getattr(spec, name), getattr(owner.spec, name)
            if _gives(owner.spec, name) and mine != theirs:
                raise layer.fail(
                    f"shared parameter {spec.name!r} has {name} {mine:g}, but {theirs:g} in layer {owner.layer!r}"
                )
            owner.spec = dataclasses.replace(owner.spec, **{name: mine})

    def _weigh(self, layer: Layer, top: Blobs) -> None:
        weights = layer.spec.loss_weight
        if weights and len(weights) != len(top):
            raise layer.fail(f"has {len(top)} tops, but {len(weights)} loss_weight")
        for i, blob in enumerate(top):
            weight = weights[i] if weights else (layer.loss_weight if i == 0 else 0.0)
            if weight:
                self.losses.append((blob, weight, layer.spec.top[i]))

    def _decide_backward(self, force: bool) -> None:
        """Caffe's rules: gradients flow only where something below learns and something above is a loss."""
        loss_ids = {id(blob) for blob, _, _ in self.losses}
        under_loss, skipped = set(loss_ids), set()
        for at in reversed(self.connections):
            contributes = any(id(t) in under_loss for t in at.top)
            wanted = any(id(t) not in skipped for t in at.top)
            if not (contributes and wanted):
                at.needs_backward, at.propagate_down = False, [False] * len(at.bottom)
            for i, b in enumerate(at.bottom):
                if contributes:
                    under_loss.add(id(b))
                if not at.propagate_down[i]:
                    skipped.add(id(b))
        for at in self.connections:
            if force:
                at.needs_backward = True
                at.propagate_down = [
                    down or at.layer.allow_force_backward(i) for i, down in enumerate(at.propagate_down)
                ]
            at.layer.needs_backward = at.needs_backward
            at.layer.needs_bottom_diff = any(at.propagate_down)

    # ------------------------------------------------------------------------------------------ running

    def _plan(self) -> None:
        """Decide what runs in slices, and watch the blobs that are hidden by it."""
        for blob in self.blobs.values():
            blob._on_look = None
        fixed = {id(self.blobs[n]) for n in [*self.inputs, *self.outputs]} | {id(b) for b, _, _ in self.losses}
        self.steps: list[WholeStep | SlicedRun]
        if self._by_layer:
            self.steps = [WholeStep(at) for at in self.connections]
        else:
            self.steps = slices.plan(self.connections, lambda b: id(b) in fixed or id(b) in self._visible)
        for step in self.steps:
            for blob in step.hidden:
                blob._on_look = functools.partial(_look, weakref.ref(self), blob)

    def _reveal(self, blob: Blob) -> None:
        """Somebody looks at a hidden blob: store it from now on, with what the last pass put there."""
        self._visible.add(id(blob))
        self._replan()

    def _replan(self) -> None:
        """Plan anew, and let the new steps know what the old ones knew: values, winners, masks."""
        runs = [step for step in self.steps if isinstance(step, SlicedRun)]
        self._plan()
        for run in runs:
            self._repeat(run)

    def _repeat(self, run: SlicedRun) -> None:
        """Compute again what ``run`` computed in the last pass; whatever others can see stays as it is."""
        inside = {id(at) for at in run.connections}
        steps = [step for step in self.steps if id(step.connections[0]) in inside]
        params = [p for at in run.connections for p in at.layer.blobs]
        now = [(p.data, p.data.copy()) for p in params]
        _put_back(run.weights)
        if self._seen[0]:
            kept = [(b.data, b.data.copy()) for b in run.outside("top")]
            for step in steps:
                step.forward()
            _put_back(kept)
        if self._seen[1]:
            kept = [(b.diff, b.diff.copy()) for b in [*run.outside("bottom"), *params]]
            for step in reversed(steps):
                step.backward()
            _put_back(kept)
        _put_back(now)

    def forward(
        self, blobs: Iterable[str] | None = None, start: str | None = None, end: str | None = None, **inputs: Any
    ) -> dict[str, NDArray[Any]]:
        """Run the layers ``start`` to ``end`` (both included; default all) and return the outputs.

        ``inputs`` are arrays for input blobs; a new shape reshapes the net. ``blobs`` names more blobs to return.
        """
        self._set_inputs({name: np.asarray(array) for name, array in inputs.items()})
        if start is None and end is None:
            self.run_forward()
        else:
            for step in self._part(start, end):
                step.forward()
        names = [end] if end in self.blobs else self.outputs
        return {name: self._blob(name).data for name in [*names, *(blobs or [])]}

    def run_forward(self) -> float:
        """Run all layers; returns the loss, the sum of loss_weight x top over all losses."""
        for step in self.steps:
            step.forward()
        self._seen = [True, False]
        return self.loss()

    def loss(self) -> float:
        """The loss of the last forward pass."""
        return float(sum(weight * float(blob.data.sum(dtype=np.float64)) for blob, weight, _ in self.losses))

    def backward(
        self, diffs: Iterable[str] | None = None, start: str | None = None, end: str | None = None, **tops: Any
    ) -> dict[str, NDArray[Any]]:
        """Run the layers backwards from ``start`` to ``end``; returns the diffs of the inputs.

        ``tops`` are arrays for the diffs of output blobs; ``diffs`` names more blobs whose diff to return.
        """
        steps = self.steps if start is None and end is None else self._part(end, start)
        self._seed_losses()
        for name, array in tops.items():
            self._blob(name).diff[...] = array
        for step in reversed(steps):
            step.backward()
        self._seen[1] = True
        return {name: self._blob(name).diff for name in [*self.inputs, *(diffs or [])]}

    def run_backward(self) -> None:
        """Run all layers backwards; the diffs of the parameters are added to."""
        self._seed_losses()
        for step in reversed(self.steps):
            step.backward()
        self._seen[1] = True

    def _seed_losses(self) -> None:
        for blob, weight, _ in self.losses:
            blob.diff[...] = weight

    def _part(self, first: str | None, last: str | None) -> list[WholeStep | SlicedRun]:
        """The steps of some layers. A net that is run in parts runs layer by layer from then on."""
        if not self._by_layer:
            self._by_layer = True
            self._replan()
        names = [layer.name for layer in self.layers]
        for name in (first, last):
            if name is not None and name not in names:
                raise NetlibError(f"net {self.name!r} has no layer {name!r}{did_you_mean(name, names)}")
        begin = 0 if first is None else names.index(first)
        stop = len(names) if last is None else names.index(last) + 1
        return self.steps[begin:stop]

    def _set_inputs(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write input blobs; new shapes reshape the net, once."""
        reshaped = False
        for name, array in arrays.items():
            if name not in self.inputs:
                raise NetlibError(f"net {self.name!r} has no input {name!r}{did_you_mean(name, self.inputs)}; "
                                  f"its inputs: {', '.join(self.inputs) or 'none'}")  # fmt: skip
            blob = self.blobs[name]
            if array.ndim != len(blob.shape):
                raise LayerError(f"input {name!r} has shape {blob.shape}, given an array of shape {array.shape}")
            if array.dtype.kind not in "fiub":
                raise LayerError(f"input {name!r} takes numbers, given an array of {array.dtype}")
            if array.shape != blob.shape:
                blob.reshape(array.shape)
                reshaped = True
        if reshaped:
            self.reshape()
        for name, array in arrays.items():
            _copy(array, self.blobs[name].data)

    def _blob(self, name: str | None) -> Blob:
        if name not in self.blobs:
            raise NetlibError(f"net {self.name!r} has no blob {name!r}{did_you_mean(str(name), self.blobs)}")
        return self.blobs[str(name)]

    def reshape(self) -> None:
        """Shape all blobs anew, after an input blob was reshaped."""
        for at in self.connections:
            at.layer.reshape(at.bottom, at.top)
        self._seen = [False, False]
        self._plan()

    def clear_param_diffs(self) -> None:
        """Set the gradients of all parameters to zero."""
        for param in self.learnable:
            param.blob.clear_diff()

    def first_not_finite(self) -> str | None:
        """Where in the net NaN or infinity first appears, in words; None if nowhere."""
        for at in self.connections:
            for i, param in enumerate(at.layer.blobs):
                if not np.isfinite(param.data).all():
                    return f"parameter {i} of layer {at.layer.name!r}"
            for name, blob in zip(at.layer.spec.top, at.top):
                if not np.isfinite(blob.data).all():
                    return f"top blob {name!r} of layer {at.layer.name!r}"
        return None

    # ------------------------------------------------------------------------------------------ weights

    def copy_from(self, source: str | Path | Net, strict: bool = False) -> tuple[list[str], list[str]]:
        """Copy weights by layer name from a snapshot or another net.

        Returns the layers of the source that are not in this net, and those of this net that are not in the source
        and keep their values. Raises WeightsError if a shape does not fit, if no layer fits at all, or, if
        ``strict``, if a layer of this net is not in the source.
        """
        if isinstance(source, Net):
            what, found = (
                f"net {source.name!r}",
                {n: {i: b.data for i, b in enumerate(p)} for n, p in source.params.items()},
            )
        else:
            what, found = str(source), snapshot.read_weights(source)
        ignored = [name for name, arrays in found.items() if name not in self.layer_dict and arrays]
        shared = [name for name, arrays in found.items() if name in self.layer_dict and arrays]
        if not shared and self.params:
            raise WeightsError(f"{what}: no layer of net {self.name!r} is in it; it has {_some(found)}, "
                               f"the net has {_some(self.params)}")  # fmt: skip
        missing_layers = [n for n in dict.fromkeys(p.layer for p in self.learnable) if n not in shared]
        if strict and missing_layers:
            raise WeightsError(f"{what}: no weights for layer {missing_layers[0]!r} of net {self.name!r}; "
                               f"it has {_some(found)}")  # fmt: skip
        writes = []
        for name in shared:
            target = self.layer_dict[name].blobs
            for i, array in found[name].items():
                if i >= len(target):
                    raise WeightsError(f"{what}: layer {name!r} has {len(found[name])} parameters, "
                                       f"the net expects {len(target)}")  # fmt: skip
                if array.shape != target[i].shape:
                    array = _legacy_shape(array, target[i].shape)
                if array.shape != target[i].shape:
                    raise WeightsError(f"{what}: layer {name!r} parameter {i} has shape {array.shape}, "
                                       f"the net expects {target[i].shape}")  # fmt: skip
                writes.append((target[i], array))
            own = [p.index for p in self.learnable if p.layer == name]
            missing = [i for i in own if i not in found[name]]
            if missing:
                raise WeightsError(f"{what}: layer {name!r} lacks parameter {missing[0]}, the net has {len(own)}")
        for blob, array in writes:  # only after every check: a net is never half copied
            blob.data[...] = array
        return ignored, missing_layers

    def share_params(self, other: Net) -> None:
        """Use the other net's parameters, by layer name (a test net those of the training net)."""
        for name, theirs in other.params.items():
            mine = self.params.get(name)
            if mine is None:
                continue
            if [blob.shape for blob in mine] != [blob.shape for blob in theirs]:
                raise LayerError(f"layer {name!r} has parameters {[b.shape for b in mine]} in net {self.source}, "
                                 f"{[b.shape for b in theirs]} in {other.source}")  # fmt: skip
            for blob, owner in zip(mine, theirs):
                blob.share(owner)

    def save(self, path: str | Path) -> None:
        """Write the weights as Caffe's HDF5, atomically."""
        snapshot.write_weights(self, path)

    def layer_states(self) -> dict[str, Any]:
        """State of every layer, by name, for an exact resume."""
        return {layer.name: layer.state() for layer in self.layers}

    def restore_layer_states(self, states: Mapping[str, Any]) -> None:
        """Take back what ``layer_states`` gave."""
        for name, state in states.items():
            if name in self.layer_dict:
                self.layer_dict[name].restore(state)


def _gives(spec: ParamSpec, name: str) -> bool:
    """Does the prototxt say this field?"""
    tree = schema.tree_of(spec)
    return tree is not None and bool(tree.values(name))


def _look(net: weakref.ref[Net], blob: Blob) -> None:
    """Tell the net, if it is still there, that somebody looks at a hidden blob."""
    if (owner := net()) is not None:
        owner._reveal(blob)


def _check_name(spec: LayerParameter) -> None:
    """A layer's name becomes a group of the HDF5 snapshots. Raises LayerError for one that cannot."""
    parts = spec.name.split("/")
    if any(part in ("", ".", "..") for part in parts) or not spec.name.isprintable():
        raise LayerError(f"{schema.position_of(spec, 'name')}: error: a layer of type {spec.type!r} has the name "
                         f"{spec.name!r}; expected a name that a snapshot can store")  # fmt: skip
    if parts[-1].isdigit() and len(parts) > 1:
        raise LayerError(f"{schema.position_of(spec, 'name')}: error: layer {spec.name!r}: the part after the last "
                         "slash must not be a number, or snapshots could not tell it from a parameter")  # fmt: skip


def _copy(source: NDArray[Any], target: NDArray[Any]) -> None:
    """Copy a batch, on all threads if it is large."""
    if target.nbytes < 1 << 20:
        target[...] = source
        return

    def job(rows: slice) -> None:
        target[rows] = source[rows]

    parallel.run([functools.partial(job, rows) for rows in parallel.blocks(len(target), -(-len(target) // 16))])


def _put_back(kept: list[tuple[NDArray[Any], NDArray[Any]]]) -> None:
    for array, values in kept:
        array[...] = values


def _legacy_shape(array: NDArray[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """Weights of Caffe before N-d blobs are 4-d, with leading ones."""
    if array.ndim == 4 and len(shape) < 4 and array.shape == (1,) * (4 - len(shape)) + shape:
        return array.reshape(shape)
    return array


def _some(names: Iterable[str]) -> str:
    names = list(names)
    return ", ".join(names[:8]) + (" ..." if len(names) > 8 else "") or "no layers"


# ---------------------------------------------------------------------------------------------- reading nets


def load_parameter(model: str | Path | NetParameter | Message) -> NetParameter:
    """Read a net. Raises PrototxtError for mistakes, and for a file without layers."""
    if isinstance(model, NetParameter):
        return model
    tree = model if isinstance(model, Message) else prototxt.parse_file(model)
    for item in tree.fields:
        if item.name == "layers":
            raise PrototxtError(
                item.position,
                "'layers' is Caffe's V1 format; expected 'layer' (Caffe's upgrade_net_proto_text converts)",
            )
    param = schema.read(tree, NetParameter, "net")
    if not param.layer and not param.input:
        raise PrototxtError(tree.position, "no layer in this file; expected a net")
    return param


def select_layers(param: NetParameter, state: NetState) -> list[LayerParameter]:
    """The layers that a net in this state has; old-style inputs become an Input layer."""
    chosen = [_input_layer(param)] if param.input else []
    for spec in param.layer:
        if spec.include and spec.exclude:
            raise PrototxtError(schema.position_of(spec), f"layer {spec.name!r} has both include and exclude rules")
        if spec.include:
            wanted = any(meets(state, rule) for rule in spec.include)
        else:
            wanted = not any(meets(state, rule) for rule in spec.exclude)
        if wanted:
            chosen.append(spec)
    return chosen


def meets(state: NetState, rule: NetStateRule) -> bool:
    """Does a state meet every condition of a rule?"""
    return (
        (rule.phase is None or rule.phase == state.phase)
        and (rule.min_level is None or state.level >= rule.min_level)
        and (rule.max_level is None or state.level <= rule.max_level)
        and all(stage in state.stage for stage in rule.stage)
        and not any(stage in state.stage for stage in rule.not_stage)
    )


def _input_layer(param: NetParameter) -> LayerParameter:
    """``input: "x" input_dim: 1 ...`` or ``input_shape { ... }`` as the Input layer it stands for."""
    where = schema.position_of(param, "input")
    dims: list[Sequence[int]]
    if param.input_shape:
        dims = [shape.dim for shape in param.input_shape]
    else:
        dims = [param.input_dim[i : i + 4] for i in range(0, len(param.input_dim), 4)]
    if len(dims) not in (1, len(param.input)) or len(param.input_dim) % 4:
        raise PrototxtError(where, f"{len(param.input)} inputs need as many input_shape, found {len(dims)}")
    shapes = [
        Field(
            "shape",
            Message([Field("dim", Scalar("number", str(n), where), where) for n in d], where),
            where,
        )
        for d in dims
    ]
    block = Message(shapes, where)
    return LayerParameter(name="input", type="Input", top=param.input, blocks={"input_param": block})
