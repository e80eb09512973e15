"""Run a layer on an example: fill its blobs and return the results of its methods."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from exercises.exercise import Values
from netlib import gradcheck
from netlib.blob import Array, Blob, Blobs
from netlib.building.create import create
from netlib.layer import Layer
from netlib.proto import prototxt, schema
from netlib.proto.messages import LayerParameter
from netlib.proto.schema import Phase

BIT_GENERATOR = np.random.SFC64  # the bit generator of a layer, as in a net


@dataclass(frozen=True)
class Letters:
    """The names of a layer's blobs in its docstring, and the axes of each."""

    bottoms: tuple[str, ...]
    tops: tuple[str, ...]
    params: tuple[str, ...] = ()
    axes: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def all_axes(self) -> dict[str, Sequence[str]]:
        """Return the axes of each blob's data and diff, by name."""
        after = {f"{name} (after forward)": axes for name, axes in self.axes.items()}
        return {f"{d}{name}": axes for name, axes in self.axes.items() for d in ("", "d")} | after


@dataclass(frozen=True, eq=False)
class Example:
    """A layer with its inputs, which avoid points where it is not differentiable unless ``on_kinks``.

    options   the fields of its ``layer { ... }`` except the type
    wanted    which bottoms get a gradient; default: all
    gradient  whether to check it by finite differences
    on_kinks  whether some inputs are points where the layer is not differentiable: the gradient, for a top diff of 0.5,
              is compared with the reference layer's instead
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
    on_kinks: bool = False

    @property
    def title(self) -> str:
        """Description for messages."""
        bottoms = " and ".join(str(array.shape) for array in self.bottoms)
        how = [f"bottom {bottoms}"] + ["in place"] * self.in_place + ["in phase TEST"] * (self.phase == "TEST")
        return "; ".join([part for part in (self.options, self.note) if part] + how)


def numbers(*shape: int, seed: int = 0) -> Array:
    """Return random values of both signs with magnitudes from 0.2 to 1, away from 0."""
    rng = np.random.default_rng(seed)
    return np.asarray(rng.choice([-1.0, 1.0], shape) * rng.uniform(0.2, 1, shape))


@dataclass
class Run:
    """A layer set up and reshaped for an example, with its blobs."""

    layer: Layer
    bottom: Blobs
    top: Blobs


def built(part: type[Layer], type_name: str, example: Example, dtype: DTypeLike) -> Run:
    """Create the layer and fill its bottoms and parameters."""
    tree = prototxt.parse(f'type: "{type_name}" {example.options}', "<exercise>")
    spec: Any = schema.read(tree, LayerParameter)
    tops = tuple(f"top[{i}]" for i in range(example.tops))
    bottoms = tuple(f"bottom[{i}]" for i in range(len(example.bottoms)))
    spec = schema.changed(spec, name=type_name, bottom=bottoms, top=bottoms[:1] if example.in_place else tops)
    rng = np.random.Generator(BIT_GENERATOR(0))
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


def forward(run: Run, letters: Letters, example: Example) -> Values:
    """Run forward with tops initialized to NaN; returns the tops, then the bottoms, which must not change."""
    for _ in range(example.forwards):
        for blob in [] if example.in_place else run.top:
            blob.data[...] = np.nan
        run.layer.forward(run.bottom, run.top)
    found = {name: blob.data.copy() for name, blob in zip(letters.tops, run.top)}
    bottoms = [] if example.in_place else zip(letters.bottoms, run.bottom)
    return found | {f"{name} (after forward)": blob.data.copy() for name, blob in bottoms}


def backward(run: Run, top_diffs: Sequence[Array], letters: Letters) -> Values:
    """Run backward with bottom diffs initialized to NaN and parameter diffs to 1, as in gradcheck; returns the
    gradients.
    """
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


def gradients_of(
    part: type[Layer], type_name: str, example: Example, letters: Letters
) -> Iterator[tuple[str, gradcheck.Gradient]]:
    """Yield each gradient by name, from backward and, on demand, from finite differences of forward, in float64."""
    run = built(part, type_name, example, np.float64)
    found = gradcheck.gradients(run.layer, example.bottoms, example.tops, example.wanted, in_place=example.in_place)
    for gradient in found:
        names = letters.bottoms if gradient.kind == "bottom" else letters.params
        yield f"d{names[gradient.number]}", gradient
