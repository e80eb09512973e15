"""How a layer is checked: shapes, values, gradients, each on small examples and on what Caffe recorded."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from layers import LAYER_TYPES
from netlib import gradcheck, prototxt, schema
from netlib.blob import Array, Blob, Blobs
from netlib.create import create
from netlib.layer import Layer
from netlib.messages import LayerParameter
from netlib.schema import Phase
from tools.exercises import network, recorded
from tools.exercises.exercise import Case, Check, Exercise, Mistake, Part, Remedy, Tell, Values

SINGLE, DIFFERENCES, DOUBLE = 1e-5, 2e-6, 1e-10  # tolerances: of Caffe's float32, of differences, of our own float64
AGAIN = np.random.SFC64  # the source of a layer's random numbers, as in a net


@dataclass(frozen=True)
class Letters:
    """What the docstring of a layer calls its blobs, and the axes of each."""

    bottoms: tuple[str, ...]
    tops: tuple[str, ...]
    params: tuple[str, ...] = ()
    axes: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def all_axes(self) -> dict[str, Sequence[str]]:
        """Of each blob's data and diff."""
        after = {f"{name} (after forward)": axes for name, axes in self.axes.items()}
        return {f"{d}{name}": axes for name, axes in self.axes.items() for d in ("", "d")} | after


@dataclass(frozen=True, eq=False)
class Example:
    """A layer, and what it is given: numbers that lie off the kinks.

    options   the inside of its ``layer { ... }`` besides the type
    wanted    which bottoms get a gradient; by default all
    gradient  is it checked by differences
    """

    options: str
    bottoms: tuple[Array, ...]
    tops: int = 1
    phase: Phase = "TRAIN"
    in_place: bool = False
    wanted: tuple[bool, ...] | None = None
    gradient: bool = True
    params: tuple[Array, ...] = ()
    note: str = ""
    forwards: int = 1

    @property
    def title(self) -> str:
        """For a message."""
        bottoms = " and ".join(str(array.shape) for array in self.bottoms)
        how = [f"bottom {bottoms}"] + ["in place"] * self.in_place + ["in phase TEST"] * (self.phase == "TEST")
        return "; ".join([part for part in (self.options, self.note) if part] + how)


def numbers(*shape: int, seed: int = 0) -> Array:
    """Numbers between 0.2 and 1, of both signs: away from 0."""
    rng = np.random.default_rng(seed)
    return np.asarray(rng.choice([-1.0, 1.0], shape) * rng.uniform(0.2, 1, shape))


@dataclass
class Run:
    """A layer that was set up and shaped for an example, with its blobs."""

    layer: Layer
    bottom: Blobs
    top: Blobs


def built(part: type[Layer], type_name: str, example: Example, dtype: DTypeLike) -> Run:
    """The layer, with numbers in its bottoms and parameters."""
    tree = prototxt.parse(f'type: "{type_name}" {example.options}', "<exercise>")
    spec: Any = schema.read(tree, LayerParameter)
    tops = tuple(f"top[{i}]" for i in range(example.tops))
    bottoms = tuple(f"bottom[{i}]" for i in range(len(example.bottoms)))
    spec = schema.changed(spec, name=type_name, bottom=bottoms, top=bottoms[:1] if example.in_place else tops)
    rng = np.random.Generator(AGAIN(0))
    layer = create(spec, example.phase, rng, dtype, lambda cls: part)
    bottom = Blobs([_filled(array, dtype) for array in example.bottoms], dtype)
    top = Blobs([bottom[0]] if example.in_place else [Blob((), dtype) for _ in tops], dtype)
    layer.setup(bottom, top)
    for i, blob in enumerate(layer.blobs):
        blob.data[...] = example.params[i] if example.params else numbers(*blob.shape, seed=10 + i)
    layer.reshape(bottom, top)
    return Run(layer, bottom, top)


def _filled(array: Array, dtype: DTypeLike) -> Blob:
    blob = Blob(array.shape, dtype)
    blob.data[...] = array
    return blob


def checks(
    type_name: str,
    letters: Letters,
    examples: Sequence[Example],
    from_caffe: Mapping[str, Example],
    ours: type[Layer],
    shaped_by: str,
) -> tuple[Check, ...]:
    """The steps of a layer. ``from_caffe`` are recorded cases; of their examples only the options count."""
    axes = letters.all_axes()
    theirs = {name: _as_recorded(name, example) for name, example in from_caffe.items()}
    shapes, values, gradients = [], [], []

    for example in examples:

        def shape(part: Part, example: Example = example) -> Values:
            run = built(part, type_name, example, np.float64)
            return {name: np.zeros(blob.shape) for name, blob in zip(letters.tops, run.top)}

        def value(part: Part, example: Example = example) -> Values:
            return _forward(built(part, type_name, example, np.float64), letters, example)

        def gradient(part: Part, example: Example = example) -> Values:
            return {name: g.said for name, g in _gradients(part, type_name, example, letters)}

        def differences(part: Part, example: Example = example) -> Values:
            return {name: g.differences() for name, g in _gradients(part, type_name, example, letters)}

        shapes.append(Case(example.title, shape, _by(shape, ours), "ours", axes, 0, shaped_by))
        values.append(Case(example.title, value, _by(value, ours), "our layer has", axes, DOUBLE, "forward"))
        if example.gradient:
            gradients.append(Case(example.title, gradient, differences, "the differences say", axes, DIFFERENCES,
                                  "backward"))  # fmt: skip
    caffes_values, caffes_gradients = [], []
    for name, example in theirs.items():

        def caffe_value(part: Part, example: Example = example) -> Values:
            return _forward(built(part, type_name, example, np.float32), letters, example)

        def caffe_gradient(part: Part, name: str = name, example: Example = example) -> Values:
            return _backward(built(part, type_name, example, np.float32), recorded.of_layer(name, "topdiff"), letters)

        tops = dict(zip(letters.tops, recorded.of_layer(name, "top")))
        diffs = dict(zip([f"d{x}" for x in letters.bottoms], recorded.of_layer(name, "indiff")))
        diffs |= dict(zip([f"d{x}" for x in letters.params], recorded.of_layer(name, "pdiff")))
        caffes_values.append(Case(example.title, caffe_value, _given(tops), "Caffe has", axes, SINGLE, "forward"))
        caffes_gradients.append(
            Case(example.title, caffe_gradient, _given(diffs), "Caffe has", axes, SINGLE, "backward")
        )
    return (
        Check("shapes", tuple(shapes)),
        Check("values: forward makes the numbers that Caffe made", tuple(caffes_values + values)),
        Check("gradient: backward agrees with differences of forward, and with Caffe",
              tuple(gradients + caffes_gradients)),
    )  # fmt: skip


def _by(run: Any, ours: Part) -> Any:
    return lambda part: run(ours)


def _given(values: Values) -> Any:
    return lambda part: values


def _as_recorded(name: str, example: Example) -> Example:
    bottoms, params = recorded.of_layer(name, "in"), recorded.of_layer(name, "param")
    return Example(example.options, tuple(bottoms), example.tops, example.phase, params=tuple(params))


def _forward(run: Run, letters: Letters, example: Example) -> Values:
    """The tops, which begin as NaN; then the bottoms, which no forward may change."""
    for _ in range(example.forwards):
        for blob in [] if example.in_place else run.top:
            blob.data[...] = np.nan
        run.layer.forward(run.bottom, run.top)
    found = {name: blob.data.copy() for name, blob in zip(letters.tops, run.top)}
    bottoms = [] if example.in_place else zip(letters.bottoms, run.bottom)
    return found | {f"{name} (after forward)": blob.data.copy() for name, blob in bottoms}


def _backward(run: Run, top_diffs: Sequence[Array], letters: Letters) -> Values:
    """Bottom diffs begin as NaN, parameter diffs as ones, as in gradcheck."""
    run.layer.forward(run.bottom, run.top)
    for blob, diff in zip(run.top, top_diffs):
        blob.diff[...] = diff
    for blob in run.bottom:
        blob.diff[...] = np.nan
    for blob in run.layer.blobs:
        blob.diff[...] = 1
    run.layer.backward(run.top, [True] * len(run.bottom), run.bottom)
    found = {f"d{name}": blob.diff.copy() for name, blob in zip(letters.bottoms, run.bottom)}
    return found | {f"d{name}": blob.diff - 1 for name, blob in zip(letters.params, run.layer.blobs)}


def _gradients(
    part: type[Layer], type_name: str, example: Example, letters: Letters
) -> Iterator[tuple[str, gradcheck.Gradient]]:
    run = built(part, type_name, example, np.float64)
    found = gradcheck.gradients(run.layer, example.bottoms, example.tops, example.wanted, in_place=example.in_place)
    for gradient in found:
        names = letters.bottoms if gradient.kind == "bottom" else letters.params
        yield f"d{names[gradient.number]}", gradient


# ---------------------------------------------------------------------------------------------- mistakes of any layer


def _clears(part: type[Layer]) -> type[Layer]:
    class Clears(part):  # type: ignore[valid-type,misc]
        """Begins with bottom diffs of zeros."""

        def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
            for blob in bottom:
                if not any(blob is other for other in top):
                    blob.diff[...] = 0
            super().backward(top, propagate_down, bottom)

    return Clears


def _adds(part: type[Layer]) -> type[Layer]:
    class Adds(part):  # type: ignore[valid-type,misc]
        """Adds what backward left in the parameters' diffs to what was there."""

        def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
            before = [blob.diff.copy() for blob in self.blobs]
            for blob in self.blobs:
                blob.diff[...] = 0
            super().backward(top, propagate_down, bottom)
            for blob, kept in zip(self.blobs, before):
                blob.diff[...] += kept

    return Adds


REMEDIES = (
    Remedy(
        _clears,
        "backward adds to the diff of a bottom. It has to write it, bottom[0].diff[...] = ...: nobody clears it, so it "
        "holds old numbers, and here NaN.",
        lambda got: bool(np.isnan(got).all()),
    ),
    Remedy(
        _clears,
        "backward leaves some elements of the diff of a bottom as they were. It has to write every one, the zeros, "
        "too: nobody clears it, so it holds old numbers, and here NaN.",
        lambda got: bool(np.isnan(got).any()),
    ),
    Remedy(
        _adds,
        "backward overwrites the diff of a parameter. It has to add to it, with +=: the solver sums the gradients of "
        "several batches there, and of layers that share a parameter.",
    ),
)


# ---------------------------------------------------------------------------------------------- the exercise


@contextlib.contextmanager
def in_place_of(type_name: str, part: type[Layer]) -> Iterator[None]:
    """Within it, nets make this class for layers of the type."""
    before = LAYER_TYPES[type_name]
    LAYER_TYPES[type_name] = part
    try:
        yield
    finally:
        LAYER_TYPES[type_name] = before


def layer_exercise(
    name: str,
    type_name: str,
    *,
    title: str,
    chapter: int,
    file: str,
    to_do: Mapping[str, str],
    letters: Letters,
    examples: Sequence[Example],
    from_caffe: Mapping[str, Example],
    mistakes: Sequence[Mistake],
    shaped_by: str = "reshape",
) -> Exercise:
    """The exercise to write a layer; ``to_do`` names its methods, ``shaped_by`` the one that says the tops' shapes."""
    ours = LAYER_TYPES[type_name]
    cls = ours.__name__

    def train(part: Part, iterations: int, tell: Tell) -> Array:
        with in_place_of(type_name, part):
            return network.losses(iterations, tell)

    return Exercise(
        name=name,
        title=title,
        chapter=chapter,
        file=file,
        to_do={f"{cls}.{method}": task for method, task in to_do.items()},
        names=tuple(f"{cls}.{method}" for method in ("setup", "reshape", "forward", "backward")),
        part_of=lambda module: getattr(module, cls),
        ours=ours,
        checks=checks(type_name, letters, examples, from_caffe, ours, shaped_by),
        mistakes=tuple(mistakes),
        train=train,
        remedies=REMEDIES,
    )
