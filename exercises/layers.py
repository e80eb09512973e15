"""Layer exercises: the steps that check a layer, without options first, then with one option
after the other.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
from numpy.typing import DTypeLike

from exercises import network, recorded
from exercises.exercise import Case, Check, Exercise, Mistake, Part, Values, replaced
from layers import LAYER_TYPES
from netlib import gradcheck
from netlib.blob import Array, Blob, Blobs
from netlib.layer import Layer
from netlib.proto.schema import Phase

KEPT = 7.0  # initial value of a diff that backward must not write
NOT_DOWN = "propagate_down: false"
LEAVE = "If propagate_down is false for a bottom, backward must not write its diff: no layer needs this gradient."
# tolerances: Caffe's float32, finite differences, float64 reference
SINGLE, DIFFERENCES, DOUBLE = 1e-5, 2e-6, 1e-10


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
    """A layer with its inputs, which avoid points where it is not differentiable
    unless ``on_kinks``.

    options   the fields of its block, or of its ``layer { ... }`` except the type
    option    the option that it shows, in a separate step; empty: none
    caffe     name of the recorded case that holds the inputs, parameters and Caffe's results
    gradient  whether to check it
    on_kinks  compare the gradient with the reference layer's, not with finite differences
    """

    options: str
    bottoms: tuple[Array, ...] = ()
    option: str = ""
    caffe: str = ""
    tops: int = 1
    phase: Phase = "TRAIN"
    in_place: bool = False
    gradient: bool = True
    on_kinks: bool = False

    @property
    def inputs(self) -> Sequence[Array]:
        """The data of the bottoms."""
        return recorded.of_layer(self.caffe, "in") if self.caffe else self.bottoms

    @property
    def title(self) -> str:
        """Description for messages."""
        bottoms = " and ".join(str(array.shape) for array in self.inputs)
        return "; ".join(part for part in (self.options, f"bottom {bottoms}") if part)


def numbers(*shape: int, seed: int = 0) -> Array:
    """Return random values of both signs with magnitudes from 0.2 to 1, away from 0."""
    rng = np.random.default_rng(seed)
    return np.asarray(rng.choice([-1.0, 1.0], shape) * rng.uniform(0.2, 1, shape))


@dataclass(frozen=True)
class _Runner:
    """Runs the class ``class_name`` of a part on an example."""

    type_name: str
    class_name: str
    letters: Letters
    example: Example

    def built(self, part: Part, dtype: DTypeLike) -> tuple[Layer, Blobs, Blobs]:
        """Return the layer with its bottoms, filled, and its tops, which have their shapes."""
        example, params = self.example, recorded.of_layer(self.example.caffe, "param")
        with replaced(LAYER_TYPES, self.type_name, getattr(part, self.class_name)):
            layer = gradcheck.make_layer(
                f'type: "{self.type_name}" {example.options}',
                example.inputs,
                example.tops,
                example.phase,
                dtype=dtype,
            )
        for i, blob in enumerate(layer.blobs):
            blob.data[...] = params[i] if params else numbers(*blob.shape, seed=10 + i)
        bottom = Blobs([Blob(array.shape, dtype) for array in example.inputs], dtype)
        for blob, array in zip(bottom, example.inputs):
            blob.data[...] = array
        top = Blobs(
            [bottom[0]] if example.in_place else [Blob((), dtype) for _ in range(example.tops)],
            dtype,
        )
        layer.reshape(bottom, top)
        return layer, bottom, top

    def shapes(self, part: Part) -> Values:
        """Return tops of zeros."""
        _, _, top = self.built(part, np.float64)
        return {name: np.zeros(blob.shape) for name, blob in zip(self.letters.tops, top)}

    def values(self, part: Part) -> Values:
        """Run forward with tops initialized to NaN; returns the tops, then the bottoms, which
        must not change.
        """
        layer, bottom, top = self.built(part, np.float32 if self.example.caffe else np.float64)
        for blob in [] if self.example.in_place else top:
            blob.data[...] = np.nan
        layer.forward(bottom, top)
        bottoms = (
            []
            if self.example.in_place
            else [f"{name} (after forward)" for name in self.letters.bottoms]
        )
        names = [*self.letters.tops[: len(top)], *bottoms]
        return {name: blob.data.copy() for name, blob in zip(names, [*top, *bottom])}

    def gradient(self, part: Part) -> Values:
        """Run backward with bottom diffs initialized to NaN and parameter diffs to 1; returns
        the gradients.
        """
        if not self.example.caffe:
            return {name: gradient.analytic for name, gradient in self._gradients(part)}
        layer, bottom, top = self.built(part, np.float32)
        layer.forward(bottom, top)
        for blob, diff in zip(top, recorded.of_layer(self.example.caffe, "topdiff")):
            blob.diff[...] = diff
        for blob in bottom:
            blob.diff[...] = np.nan
        for blob in layer.blobs:
            blob.diff[...] = 1
        layer.backward(top, [True] * len(bottom), bottom)
        return self._by_letter(
            [blob.diff.copy() for blob in bottom] + [blob.diff - 1 for blob in layer.blobs]
        )

    def unwanted(self, part: Part) -> Values:
        """Run backward without propagate_down of the last bottom; returns its diff, which was
        initialized to KEPT.
        """
        layer, bottom, top = self.built(part, np.float64)
        layer.forward(bottom, top)
        for blob in top:
            blob.diff[...] = numbers(*blob.shape)
        bottom[-1].diff[...] = KEPT
        layer.backward(top, [*[True] * (len(bottom) - 1), False], bottom)
        return {f"d{self.letters.bottoms[-1]}": bottom[-1].diff}

    def differences(self, part: Part) -> Values:
        """Return the finite differences of forward."""
        return {name: gradient.differences() for name, gradient in self._gradients(part)}

    def _gradients(self, part: Part) -> Iterator[tuple[str, gradcheck.Gradient]]:
        layer, _, _ = self.built(part, np.float64)
        example = self.example
        found = gradcheck.gradients(layer, example.inputs, example.tops, in_place=example.in_place)
        for gradient in found:
            names = self.letters.bottoms if gradient.kind == "bottom" else self.letters.params
            yield f"d{names[gradient.number]}", gradient

    def _by_letter(self, gradients: Sequence[Array]) -> Values:
        return {
            f"d{name}": array
            for name, array in zip(self.letters.bottoms + self.letters.params, gradients)
        }

    def cases(self, reference: Part, shaped_by: str) -> Iterator[Case]:
        """Yield the cases: the shapes, forward, and backward unless its gradient is not checked."""
        example, ours = self.example, "the reference layer has"

        def case(
            run: Callable[[Part], Values],
            wanted: Callable[[], Values],
            source: str,
            tolerance: float,
            method: str,
        ) -> Case:
            return Case(
                example.title, run, wanted, source, self.letters.all_axes(), tolerance, method
            )

        yield case(self.shapes, lambda: self.shapes(reference), "expected", 0, shaped_by)
        if example.caffe:
            tops, diffs, of_params = (
                recorded.of_layer(example.caffe, kind) for kind in ("top", "indiff", "pdiff")
            )
            yield case(
                self.values,
                lambda: dict(zip(self.letters.tops, tops)),
                "Caffe has",
                SINGLE,
                "forward",
            )
            yield case(
                self.gradient,
                lambda: self._by_letter(diffs + of_params),
                "Caffe has",
                SINGLE,
                "backward",
            )
            return
        yield case(self.values, lambda: self.values(reference), ours, DOUBLE, "forward")
        if example.on_kinks:
            yield case(self.gradient, lambda: self.gradient(reference), ours, DOUBLE, "backward")
        elif example.gradient:
            yield case(
                self.gradient,
                lambda: self.differences(reference),
                "finite differences give",
                DIFFERENCES,
                "backward",
            )


def layer_exercise(
    name: str,
    type_name: str,
    *,
    title: str,
    chapter: int,
    file: str,
    block: str = "",
    to_do: Mapping[str, str],
    letters: Letters,
    examples: Sequence[Example],
    mistakes: tuple[Mistake, ...],
    hints: Mapping[str, str] | None = None,
    shaped_by: str = "reshape",
) -> Exercise:
    """Return the exercise for a layer.

    block      the field of a layer that has its options, such as relu_param
    to_do      maps its methods to instructions
    examples   those without an option first; the options in the order in which a reader adds them
    hints      what the layer must do for an option of the examples
    shaped_by  the method that sets the tops' shapes
    """
    if block:
        blocks = [old.options and f"{block} {{ {old.options} }}" for old in examples]
        examples = [
            dataclasses.replace(old, options=options) for old, options in zip(examples, blocks)
        ]
    cls = LAYER_TYPES[type_name]
    reference = SimpleNamespace(**{cls.__name__: cls})
    cases: dict[str, list[Case]] = {}  # by option
    for example in examples:
        runner = _Runner(type_name, cls.__name__, letters, example)
        cases.setdefault(example.option, []).extend(runner.cases(reference, shaped_by))
    first = _Runner(type_name, cls.__name__, letters, examples[0])
    not_down = Case(
        examples[0].title,
        first.unwanted,
        lambda: first.unwanted(reference),
        "expected",
        letters.all_axes(),
        0,
        "backward",
    )
    cases[NOT_DOWN] = [not_down]
    has_caffes = any(example.caffe and not example.option for example in examples)
    source = "Caffe" if has_caffes else "the reference"
    titles = {
        shaped_by: "shapes",
        "forward": f"values: forward agrees with {source}",
        "backward": f"gradient: backward agrees with finite differences and with {source}",
    }
    without_option = cases.pop("")
    checks = []
    for method, check_title in titles.items():
        of_method = tuple(case for case in without_option if case.method == method)
        checks.append(Check(check_title, of_method))
    all_hints = {NOT_DOWN: LEAVE, **(hints or {})}
    for option, found in cases.items():
        checks.append(Check(f"with {option}", tuple(found), option, all_hints.get(option, "")))

    def train(part: Part, iterations: int) -> Array:
        with replaced(LAYER_TYPES, type_name, getattr(part, cls.__name__)):
            return network.losses(iterations)

    return Exercise(
        name=name,
        title=title,
        chapter=chapter,
        file=file,
        to_do={f"{cls.__name__}.{method}": task for method, task in to_do.items()},
        checks=tuple(checks),
        mistakes=mistakes,
        train=train,
    )
