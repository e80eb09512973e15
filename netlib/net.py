"""Net: a graph of layers (graph.py) that runs forwards and backwards, loads weights and saves them.

The interface is pycaffe's: ``net.blobs``, ``net.params``, ``net.forward()``, ``net.backward()``,
``net.save()``.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from netlib import engine as engines
from netlib.blob import Blob
from netlib.building import python_layer
from netlib.engine import Step
from netlib.errors import LayerError, NetlibError, did_you_mean
from netlib.files import Content
from netlib.graph import Graph, LayerHook
from netlib.layer import PHASES, TEST, TRAIN
from netlib.pass_state import PassState
from netlib.proto import schema
from netlib.proto.messages import NetParameter, NetState
from netlib.proto.net_parameter import load_parameter, select_layers, tops_of
from netlib.proto.prototxt import Message
from netlib.snapshots import snapshot
from netlib.snapshots import weights as weights_of

log = logging.getLogger("netlib")

_seeds: np.random.Generator | None = None


def set_random_seed(seed: int) -> None:
    """Set the seed from which nets and solvers without a seed draw theirs."""
    global _seeds
    _seeds = np.random.default_rng(seed)


def next_seed() -> int | None:
    """Draw the next seed; None (a new one each run) unless ``set_random_seed`` was called."""
    return None if _seeds is None else int(_seeds.integers(2**31))


class Net(Graph):
    """A net of layers.

    ``Net(model, phase)`` or ``Net(model, weights, phase)``; ``model`` is a file or a parsed
    NetParameter. ``engine`` is "plain" or "fast" (netlib/engine.py). ``python_layers=False``
    rejects nets with layers of type Python. ``layer_hook`` is called with each layer before and
    after its setup.

    blobs           name -> Blob, in the order of creation
    params          layer name -> its parameters, for layers that have any
    inputs, outputs names of the blobs that the caller writes, and of those that no layer reads
    layers          the layers in order
    layer_dict      name -> layer
    connections     the layers in order, each with the blobs that it reads and writes
    losses          (blob, loss weight, name) of every loss
    learnable       list of Param, each shared parameter once
    parameters      the parameters of all layers, with the shapes that the layers use
    steps           what a pass runs, in order (netlib/engine.py)

    Raises NetlibError (PrototxtError, LayerError, WeightsError) if a file is invalid.
    """

    def __init__(
        self,
        model: str | Path | NetParameter | Message,
        *args: Any,
        phase: int | None = None,
        weights: str | Path | None = None,
        dtype: DTypeLike = np.float32,
        level: int = 0,
        stages: Sequence[str] | None = None,
        state: NetState | None = None,
        seed: int | None = None,
        engine: str | None = None,
        python_layers: bool = True,
        layer_hook: LayerHook | None = None,
    ) -> None:
        for value in args:  # as in pycaffe, [weights,] phase
            if isinstance(value, (int, np.integer)):
                phase = int(value)
            else:
                weights = value
        self.dtype = np.dtype(dtype)
        if self.dtype not in (np.float32, np.float64):
            raise NetlibError(f"a net computes in float32 or float64, not in {self.dtype}")
        self.source = str(model) if isinstance(model, (str, Path)) else "<net>"
        param = load_parameter(model)
        if phase not in (None, TRAIN, TEST):
            raise NetlibError(
                f"phase {phase} is unknown; expected {TRAIN} (TRAIN) or {TEST} (TEST)"
            )
        if not isinstance(level or 0, int) or isinstance(stages, str):
            raise NetlibError(
                f"level {level!r}, stages {stages!r}: expected a number and a list of names; "
                "pass a file of weights as weights="
            )
        phase_name: schema.Phase = param.state.phase if phase is None else ("TRAIN", "TEST")[phase]
        self.state = state or NetState(
            phase_name, level or param.state.level, param.state.stage + tuple(stages or ())
        )
        self.phase = PHASES[self.state.phase]
        self.seed = next_seed() if seed is None else seed
        layers = tuple(select_layers(param, self.state))  # inputs are among them now
        self.excluded = tops_of(param.layer) - tops_of(layers)
        self.param = schema.changed(param, layer=layers, input=(), input_dim=(), input_shape=())
        python_layer.check_allowed(self.param.layer, python_layers)
        super().__init__(
            self.param, self.state.phase, engines.get(engine), self.dtype, self.seed, layer_hook
        )
        self._learnable_values = sum(param.blob.count for param in self.learnable)
        self._pass = PassState(self)
        self.one_thread = self._pass.one_thread
        if weights is not None:
            _, missing = self.copy_from(weights)
            if missing:
                log.warning(
                    "%s has no weights for %s; they keep their initial values",
                    weights,
                    ", ".join(missing),
                )

    # -------------------------------------------------------------------------------------- running

    def forward(
        self,
        blobs: Iterable[str] | None = None,
        start: str | None = None,
        end: str | None = None,
        **inputs: Any,
    ) -> dict[str, NDArray[Any]]:
        """Run the layers from ``start`` to ``end`` (inclusive; default all) and return the tops
        of the last one.

        For the whole net these are its outputs. ``inputs`` are arrays for the input blobs; a new
        shape reshapes the net. ``blobs`` names more blobs to return.
        """
        layers = self._layer_range(start, end)
        more = _names_of(blobs)
        with self.one_thread:  # inputs are shared: a second thread would overwrite them
            self._set_inputs(
                {name: _as_numbers(array, f"input {name!r}") for name, array in inputs.items()}
            )
            self._forward_steps(*layers)
        names = self.outputs if end is None else self.layer_dict[end].spec.top
        return {name: self._blob(name).data for name in [*names, *more]}

    def run_forward(self, first: int = 0, last: int | None = None) -> float:
        """Run the layers numbered ``first`` up to but not including ``last``, by default all, and
        return their loss.
        """
        self._forward_steps(first, last)
        return self.loss(slice(first, last))

    def _forward_steps(self, first: int, last: int | None) -> None:
        with self._pass.running():
            self._pass.begin_forward(first, last)
            for step in self.steps[first:last]:
                self._pass.forward(step)
            self._pass.seed_losses()  # those of a new shape

    def loss(self, layers: slice = slice(None)) -> float:
        """The loss of the last forward pass, or the part of it from some layers: the sum of
        loss_weight x top.
        """
        tops = {blob for at in self.connections[layers] for blob in at.top}
        loss = 0.0
        for blob, weight, _ in self.losses:
            if blob in tops:
                loss += weight * float(blob.data.sum(dtype=np.float64))
        return loss

    def backward(
        self,
        diffs: Iterable[str] | None = None,
        start: str | None = None,
        end: str | None = None,
        **tops: Any,
    ) -> dict[str, NDArray[Any]]:
        """Run the layers backwards from ``start`` to ``end`` and return the diffs of the last
        one's bottoms.

        For the whole net these are its inputs. ``tops`` are arrays for the diffs of output blobs;
        ``diffs`` names more blobs whose diffs to return.
        """
        layers = self._layer_range(end, start)
        more = _names_of(diffs)
        with self.one_thread:
            self._pass.seed_losses(is_backward=True)
            self._set_diffs(tops)
            self._backward_steps(*layers)
        names = self.inputs if end is None else self.layer_dict[end].spec.bottom
        return {name: self._blob(name).diff for name in [*names, *more]}

    def run_backward(self, first: int = 0, last: int | None = None) -> None:
        """Run the layers numbered ``first`` up to but not including ``last`` backwards, adding to
        parameter diffs.
        """
        with self.one_thread:
            self._pass.seed_losses(is_backward=True)
            self._backward_steps(first, last)

    def run_forward_backward(self) -> float:
        """Run all layers forwards, then backwards, as an iteration of a solver does;
        returns the loss.
        """
        loss = self.run_forward()
        with self._pass.at_once():
            self.run_backward()
        return loss

    def _backward_steps(self, first: int, last: int | None) -> None:
        with self._pass.running():
            self._pass.begin_backward(first, last)
            for step in reversed(self.steps[first:last]):
                self._pass.backward(step)

    def _layer_range(self, first: str | None, last: str | None) -> tuple[int, int | None]:
        """Begin and end of the indices of the layers ``first`` to ``last``, inclusive."""
        begin = 0 if first is None else self._layer_index(first)
        end = None if last is None else self._layer_index(last) + 1
        return begin, end

    def _layer_index(self, layer: str) -> int:
        names = list(self.layer_dict)
        if layer not in names:
            raise NetlibError(
                f"net {self.name!r} has no layer {layer!r}{did_you_mean(layer, names)}"
            )
        return names.index(layer)

    def _set_inputs(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write the input blobs; reshape the net once if any shape is new."""
        for name, array in arrays.items():
            if name not in self.inputs:
                raise NetlibError(
                    f"net {self.name!r} has no input {name!r}{did_you_mean(name, self.inputs)}; "
                    f"its inputs: {', '.join(self.inputs) or 'none'}"
                )
            blob = self.blobs[name]
            if array.ndim != len(blob.shape):
                raise LayerError(
                    f"input {name!r} has shape {blob.shape}, got an array of shape {array.shape}"
                )
            if array.shape != blob.shape:
                self._pass.is_reshaped = False
                blob.reshape(array.shape)
        if not self._pass.is_reshaped:
            self.reshape()
        for name, array in arrays.items():
            self.engine.copy(array, self.blobs[name].data)

    def _set_diffs(self, arrays: Mapping[str, Any]) -> None:
        """Write the diffs of output blobs; as in NumPy, arrays are broadcast."""
        for name, array in arrays.items():
            diff = self._blob(name).diff
            given = _as_numbers(array, f"output {name!r}")
            try:
                diff[...] = given
            except ValueError:
                raise LayerError(
                    f"output {name!r} has shape {diff.shape}, got an array of shape {given.shape}"
                ) from None

    def _blob(self, name: str | None) -> Blob:
        if name not in self.blobs:
            raise NetlibError(
                f"net {self.name!r} has no blob {name!r}{did_you_mean(str(name), self.blobs)}"
            )
        return self.blobs[str(name)]

    def reshape(self) -> None:
        """Reshape all blobs after an input blob was reshaped."""
        with self._pass.running():
            self._pass.reshape()

    # ---------------------------------------------------------------------------------------- steps

    @property
    def steps(self) -> Sequence[Step]:
        """What a pass runs, in order."""
        return self._pass.steps

    def store_all(self, wanted: bool = True) -> None:
        """Store every blob from now on, as after the first access to an unstored one; or, if not
        ``wanted``, only the needed ones from the next full pass on, without what a caller has
        written to the diffs of the others.

        The two differ in rounding. A solver state records which one was used, so that a resume is
        exact.
        """
        with self.one_thread:
            self._pass.store_all(wanted)

    @property
    def stores_all(self) -> bool:
        """Whether every blob is stored, because a caller has accessed one that was not, or
        has run a part.
        """
        return self._pass.stores_all

    def clear_param_diffs(self) -> None:
        """Set the gradients of all parameters to zero."""
        self.engine.run(
            [partial(param.blob.diff.fill, 0) for param in self.learnable], self._learnable_values
        )

    def first_not_finite(self) -> str | None:
        """Describe where in the net NaN or infinity first appears; None if all
        values are finite. A layer's parameters come before its tops.
        """
        for at in self.connections:
            for i, param in enumerate(at.layer.blobs):
                if not np.isfinite(param.data).all():
                    return f"parameter {i} of layer {at.layer.name!r}"
            for name, blob in zip(at.layer.spec.top, at.top):
                if not np.isfinite(blob.data).all():
                    return f"top blob {name!r} of layer {at.layer.name!r}"
        return None

    def __reduce_ex__(self, protocol: Any) -> Any:
        raise NetlibError(
            "a net cannot be copied or pickled; build a second net from the same file and copy the "
            "weights with copy_from, or save them"
        )

    # --------------------------------------------------------------------------- weights and states

    def copy_from(
        self, source: str | Path | Content | Net, strict: bool = False
    ) -> tuple[list[str], list[str]]:
        """Copy weights by layer name from a snapshot, from its content, or from another net.

        Returns the names of the layers that only the source has, and of those that only this net
        has, which keep their values. Raises WeightsError if a shape differs, if no layer matches,
        or, with ``strict``, if the source lacks a layer of this net.
        """
        return weights_of.copy(self, source, strict)

    def share_params(self, other: Net) -> None:
        """Share the other net's parameters, by layer name, as a test net shares those of
        the training net.

        As in Caffe, each net keeps its own gradients. Raises LayerError if shapes or dtypes differ.
        """
        weights_of.share(self, other)

    def save(self, path: str | Path) -> None:
        """Write the weights atomically, in Caffe's HDF5 format if the name ends in ``.h5``, else in
        binary format.
        """
        snapshot.write_weights(weights_of.image(self, path), path)

    def layer_states(self) -> dict[str, Any]:
        """Return the state of every layer by name, for an exact resume.

        A Python layer of pycaffe may have an attribute ``state`` of its own.
        """
        return {layer.name: type(layer).state(layer) for layer in self.layers}

    def restore_layer_states(self, states: Mapping[str, Any]) -> None:
        """Restore states that ``layer_states`` returned."""
        for name, state in states.items():
            if name in self.layer_dict:
                layer = self.layer_dict[name]
                type(layer).restore(layer, state)


def _names_of(blobs: Iterable[str] | None) -> list[str]:
    """The blobs to return. Raises NetlibError for arrays, which have to be given by name."""
    if isinstance(blobs, (str, Mapping, np.ndarray)):
        raise NetlibError(
            f"expected a list of names of blobs to return, found a {type(blobs).__name__}; arrays are given by name, "
            "as in forward(data=images)"
        )
    return list(blobs or [])


def _as_numbers(array: Any, what: str) -> NDArray[Any]:
    """Convert to an array of numbers.

    Raises LayerError for other types, ragged lists and masked arrays.
    """
    if isinstance(array, np.ma.MaskedArray):
        raise LayerError(
            f"{what} got a masked array; expected a plain one, for example array.filled(VALUE)"
        )
    try:
        numbers = np.asarray(array)
    except ValueError:
        raise LayerError(f"{what} got rows of different lengths; expected one array") from None
    if numbers.dtype.kind not in "fiub":
        raise LayerError(f"{what} got an array of {numbers.dtype}; expected numbers")
    return numbers
