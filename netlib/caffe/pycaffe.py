"""Net and solvers with pycaffe's complete interface."""

from __future__ import annotations

import functools
import logging
from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from netlib import net as core
from netlib.blob import Array, Blob, BlobVec
from netlib.caffe import removed
from netlib.engine import Connection, Step
from netlib.errors import LayerError
from netlib.graph import AUTOMATIC
from netlib.proto import messages, schema
from netlib.snapshots import weights as weights_of
from netlib.snapshots.snapshot import write_weights
from netlib.solver import Solver as CoreSolver
from netlib.training import solver_parameter
from netlib.updates import learning_rate

log = logging.getLogger("netlib")
Hook = Callable[[int], Any]  # called with the number of the layer


class Net(core.Net):
    """A net: ``Net(network_file, phase, level=0, stages=None, weights=None)``.

    The older form ``Net(network_file, weights, phase)`` is accepted too. ``forward`` and
    ``backward`` are more lenient than pycaffe's: inputs can be omitted, and a different batch size
    reshapes the net.
    """

    def __init__(self, network_file: Any, *args: Any, **options: Any) -> None:
        names: tuple[str, ...] = ("phase", "level", "stages", "weights")
        if args and isinstance(args[0], (str, Path)):
            names = ("weights", "phase")
            log.warning(
                "Net(file, weights, phase) is pycaffe's older form; expected Net(file, phase, weights=...)"
            )
        super().__init__(network_file, **dict(zip(names, args)), **options)
        self._hooks: dict[str, list[Hook]] = {}
        # with unnamed tops of losses, so that the numbers are positions
        self.blobs = OrderedDict(self._numbered)
        self.params = OrderedDict(self.params)
        self.layer_dict = OrderedDict(self.layer_dict)

    def __getattr__(self, name: str) -> Any:
        raise removed.error(self, f"{type(self).__name__!r} object", name, removed.NET)

    # ---------------------------------------------------------------------------- names and weights

    @property
    def _layer_names(self) -> list[str]:
        return [at.layer.spec.name for at in self.connections]

    # Numbers of blobs count the tops of all layers in order; the unnamed top of a loss
    # layer counts, too.

    @functools.cached_property
    def _numbered(self) -> list[tuple[str, Blob]]:
        """Name and blob of every number."""
        found: dict[Blob, tuple[str, Blob]] = {}
        for at in self.connections:
            for name, blob in zip((*at.layer.spec.top, *[AUTOMATIC] * len(at.top)), at.top):
                found.setdefault(blob, (name, blob))
        return list(found.values())

    @functools.cached_property
    def _numbers(self) -> dict[Blob, int]:
        """Id of a blob -> its number."""
        return {blob: number for number, (_, blob) in enumerate(self._numbered)}

    @property
    def _blob_names(self) -> list[str]:
        return [name for name, _ in self._numbered]

    @property
    def _blobs(self) -> BlobVec:
        return BlobVec((blob for _, blob in self._numbered), self.dtype)

    def _bottom_ids(self, layer: int) -> list[int]:
        """Numbers of the bottoms of a layer."""
        return [self._numbers[blob] for blob in self._connection(layer).bottom]

    def _top_ids(self, layer: int) -> list[int]:
        """Numbers of the tops of a layer."""
        return [self._numbers[blob] for blob in self._connection(layer).top]

    def _connection(self, layer: int) -> Connection:
        if not 0 <= layer < len(self.connections):
            raise LayerError(
                f"net {self.name!r} has {len(self.connections)} layers, found number {layer}"
            )
        return self.connections[layer]

    @property
    def _inputs(self) -> list[int]:
        """Numbers of the blobs that the caller writes."""
        return [self._numbers[self.blobs[name]] for name in self.inputs]

    @property
    def _outputs(self) -> list[int]:
        """Numbers of the blobs that no layer reads."""
        return [self._numbers[self.blobs[name]] for name in self.outputs]

    @functools.cached_property
    def _blob_loss_weights(self) -> list[float]:
        """The loss weight of every blob.

        As in Caffe, a change of this list does not change the net.
        """
        weights = {blob: weight for blob, weight, _ in self.losses}
        return [weights.get(blob, 0.0) for blob in self._blobs]

    @property
    def top_names(self) -> OrderedDict[str, list[str]]:
        """Layer name -> names of its tops."""
        return OrderedDict((at.layer.name, list(at.layer.spec.top)) for at in self.connections)

    @property
    def bottom_names(self) -> OrderedDict[str, list[str]]:
        """Layer name -> names of its bottoms."""
        return OrderedDict((at.layer.name, list(at.layer.spec.bottom)) for at in self.connections)

    @property
    def blob_loss_weights(self) -> OrderedDict[str, float]:
        """Blob name -> its loss weight."""
        return OrderedDict(zip(self._blob_names, self._blob_loss_weights))

    # -------------------------------------------------------------------------------------- running

    def before_forward(self, hook: Hook) -> None:
        """Call ``hook(number of the layer)`` before each layer runs forwards."""
        self._add_hook("before_forward", hook)

    def after_forward(self, hook: Hook) -> None:
        """Call ``hook(number of the layer)`` after each layer has run forwards."""
        self._add_hook("after_forward", hook)

    def before_backward(self, hook: Hook) -> None:
        """Call ``hook(number of the layer)`` before each layer runs backwards."""
        self._add_hook("before_backward", hook)

    def after_backward(self, hook: Hook) -> None:
        """Call ``hook(number of the layer)`` after each layer has run backwards."""
        self._add_hook("after_backward", hook)

    def _add_hook(self, when: str, hook: Hook) -> None:
        if not self._hooks:
            self._pass.store_all()
            self._pass.steps = [
                _HookedStep(step, number, self._hooks) for number, step in enumerate(self.steps)
            ]
        self._hooks.setdefault(when, []).append(hook)

    def store_all(self, wanted: bool = True) -> None:
        """Store every blob; or only the needed ones, unless hooks need a step for each layer."""
        super().store_all(wanted or bool(self._hooks))

    def _forward(self, start: int, end: int) -> float:
        """Run the layers numbered ``start`` to ``end``, inclusive, and return their loss."""
        return self.run_forward(start, end + 1)

    def _backward(self, start: int, end: int) -> None:
        """Run the layers numbered ``start`` down to ``end``, inclusive, backwards."""
        self.run_backward(end, start + 1)

    def _set_inputs(self, arrays: Mapping[str, Array]) -> None:
        """Repeat arrays along axes of length 1 to fill the inputs, as pycaffe's assignment does."""
        shapes = {name: self.blobs[name].shape for name in arrays if name in self.inputs}
        filled = {name: _filled(arrays[name], shape) for name, shape in shapes.items()}
        super()._set_inputs({**arrays, **filled})

    def forward_all(self, blobs: Iterable[str] | None = None, **inputs: Any) -> dict[str, Array]:
        """Run any number of items, batch by batch; returns outputs and ``blobs`` for all of them.

        Losses have one value per batch.
        """
        names = list(blobs or [])
        found: dict[str, list[Array]] = {name: [] for name in [*self.outputs, *names]}
        for batch in self._batch(inputs):
            _extend(found, self.forward(names, **batch))
        return _cut(found, inputs)

    def forward_backward_all(
        self, blobs: Iterable[str] | None = None, diffs: Iterable[str] | None = None, **arrays: Any
    ) -> tuple[dict[str, Array], dict[str, Array]]:
        """Run any number of items forwards and backwards, batch by batch.

        ``arrays`` are data of inputs and diffs of outputs. Returns data of the outputs and of
        ``blobs``, and diffs of the inputs and of ``diffs``.
        """
        names = list(blobs or [])
        slopes = list(diffs or [])
        data: dict[str, list[Array]] = {name: [] for name in [*self.outputs, *names]}
        diff: dict[str, list[Array]] = {name: [] for name in [*self.inputs, *slopes]}
        forwards = self._batch({name: arrays[name] for name in self.inputs if name in arrays})
        backwards = self._batch({name: arrays[name] for name in self.outputs if name in arrays})
        nothing: dict[str, Any] = {}
        for ahead, back in zip_longest(forwards, backwards, fillvalue=nothing):
            _extend(data, self.forward(names, **ahead))
            _extend(diff, self.backward(slopes, **back))
        return _cut(data, arrays), _cut(diff, arrays)

    def _batch(self, arrays: Mapping[str, Array]) -> Iterator[dict[str, Any]]:
        """Split arrays into batches of the net's size; the last one is padded with zeros."""
        if not arrays:
            return
        size = next(iter(self.blobs.values())).shape[0]
        for begin in range(0, len(next(iter(arrays.values()))), size):
            batch = {}
            for name, array in arrays.items():
                part = np.asarray(array[begin : begin + size])
                rest = np.zeros((size - len(part), *part.shape[1:]), part.dtype)
                batch[name] = np.concatenate([part, rest])
            yield batch

    def set_input_arrays(self, data: ArrayLike, labels: ArrayLike) -> None:
        """Set the images and labels of the MemoryData layer, which must be the first.

        Raises LayerError.
        """
        setter: Any = getattr(self.layers[0], "set_input_arrays", None) if self.layers else None
        if setter is None:
            raise LayerError("set_input_arrays needs a net whose first layer is a MemoryData layer")
        setter(data, labels)

    _set_input_arrays = set_input_arrays

    # -------------------------------------------------------------------------------------- weights

    def share_with(self, other: core.Net) -> None:
        """Share the parameters of another net, by layer name."""
        self.share_params(other)

    def save_hdf5(self, filename: str | Path) -> None:
        """Write the weights as HDF5, regardless of the file's name."""
        write_weights(weights_of.image(self, f"{filename}.h5"), filename)

    def load_hdf5(self, filename: str | Path) -> None:
        """Copy weights by layer name."""
        self.copy_from(filename)


def _filled(array: Array, shape: tuple[int, ...]) -> Array:
    """Repeat an array to fill a shape, except its first axis; unchanged if NumPy cannot."""
    if array.ndim != len(shape) and array.shape[:1] != shape[:1]:
        return array
    try:
        return np.broadcast_to(array, (*array.shape[:1], *shape[1:]))
    except ValueError:
        return array


def _extend(found: Mapping[str, list[Array]], batch: Mapping[str, Array]) -> None:
    """Append copies of the items of a batch."""
    for name, array in batch.items():
        found[name].extend(np.atleast_1d(array).copy())


def _cut(found: Mapping[str, list[Array]], given: Mapping[str, Array]) -> dict[str, Array]:
    """Remove the padding of the last batch."""
    count = len(next(iter(given.values()))) if given else None
    return {name: np.asarray(items[:count]) for name, items in found.items()}


class _HookedStep(Step):
    """Runs the step of a layer and calls hooks before and after it."""

    def __init__(self, step: Step, number: int, hooks: Mapping[str, list[Hook]]) -> None:
        super().__init__(step.connections[0])
        self._step, self._number, self._hooks = step, number, hooks

    def _call(self, when: str) -> None:
        for hook in self._hooks.get(when, []):
            hook(self._number)

    def forward(self) -> None:
        self._call("before_forward")
        self._step.forward()
        self._call("after_forward")

    def backward(self, at_once: bool = False) -> None:
        self._call("before_backward")
        self._step.backward()
        self._call("after_backward")


# ------------------------------------------------------------------------------------------ solvers


READ_ONCE = (
    "net",
    "net_param",
    "train_net",
    "train_net_param",
    "test_net",
    "test_net_param",
    "train_state",
    "test_state",
    "type",
    "solver_type",
    "weights",
    "random_seed",
    "layer_wise_reduce",
)


class SolverParameter:
    """The options of a solver, which can be changed during training:
    ``solver.param.base_lr = 0.01``.
    """

    _solver: Solver

    def __init__(self, solver: Solver) -> None:
        object.__setattr__(self, "_solver", solver)

    def __getattr__(self, name: str) -> Any:
        return getattr(object.__getattribute__(self, "_solver")._param, name)

    def __setattr__(self, name: str, value: Any) -> None:
        solver = self._solver
        if not hasattr(solver._param, name):
            raise AttributeError(f"a solver has no option {name!r}")
        if name in READ_ONCE:
            raise AttributeError(
                f"{name} is read once, when the solver is made; change it in the file"
            )
        solver._param = solver_parameter.checked(schema.with_values(solver._param, **{name: value}))
        solver.smoothed = deque(solver.smoothed, solver._param.average_loss)

    def __repr__(self) -> str:
        return repr(self._solver._param)


class Solver(CoreSolver):
    """A solver: ``SGDSolver(solver_file)``, or ``get_solver(solver_file)`` for the type
    given in the file.
    """

    net_class = Net
    # rule of a subclass, which overrides the file's ``type``, as in pycaffe
    update_rule: str | None = None

    def __init__(self, solver_file: str | Path, **options: Any) -> None:
        changes = (
            {} if self.update_rule is None else {"type": self.update_rule, "solver_type": None}
        )
        param = solver_parameter.read(solver_file)
        super().__init__(schema.changed(param, **changes), str(solver_file), **options)

    def __setattr__(self, name: str, value: Any) -> None:
        if name in ("net", "test_nets") and hasattr(self, name):
            raise AttributeError(
                f"solver.{name} cannot be replaced, as in pycaffe; copy weights with solver.net.copy_from(FILE), "
                "or make another solver"
            )
        super().__setattr__(name, value)

    @property
    def param(self) -> Any:
        """The options, which can be changed."""
        return SolverParameter(self)

    @param.setter
    def param(self, value: messages.SolverParameter) -> None:
        self._param = value

    @property
    def lr(self) -> float:
        """The learning rate of the next update."""
        return learning_rate(self._param, self.iter)

    def share_weights(self, net: core.Net) -> None:
        """Make a net share this solver's weights."""
        net.share_params(self.net)


class SGDSolver(Solver):
    """Stochastic gradient descent with momentum."""

    update_rule = "SGD"


class NesterovSolver(SGDSolver):
    """Nesterov's accelerated gradient."""

    update_rule = "Nesterov"


class AdaGradSolver(SGDSolver):
    """AdaGrad."""

    update_rule = "AdaGrad"


class RMSPropSolver(SGDSolver):
    """RMSProp."""

    update_rule = "RMSProp"


class AdaDeltaSolver(SGDSolver):
    """AdaDelta."""

    update_rule = "AdaDelta"


class AdamSolver(SGDSolver):
    """Adam."""

    update_rule = "Adam"


_CLASSES = {
    cls.update_rule: cls
    for cls in (SGDSolver, NesterovSolver, AdaGradSolver, RMSPropSolver, AdaDeltaSolver, AdamSolver)
}


def get_solver(solver_file: str | Path, **options: Any) -> Solver:
    """Create the solver of a prototxt file, in the class of its ``type``. Raises NetlibError."""
    kind = solver_parameter.type_of(solver_parameter.read(solver_file))
    return _CLASSES.get(kind, Solver)(solver_file, **options)
