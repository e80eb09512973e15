"""Layer exercises: the steps that check a layer, without options first, then with one option
after the other.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from types import SimpleNamespace

import numpy as np

from exercises import network, recorded
from exercises.exercise import Case, Check, Exercise, Mistake, Part, Values, replaced
from layers import LAYER_TYPES
from netlib import gradcheck
from netlib.blob import Array, Blob, Blobs
from netlib.layer import Layer
from netlib.proto.schema import Phase

NOT_DOWN, REFERENCE = "propagate_down: false", "the reference layer has"
LEAVE = (
    "If propagate_down is false for a bottom, backward must not write its diff: no layer needs this gradient. The "
    "others are needed, also those of the parameters."
)
AGAIN = (
    "One batch passes, but not a second one, with fewer items. Either a value is kept from the first batch, or "
    "backward changes an array that it must only read, such as top[0].diff."
)
# Tolerances for Caffe's float32, finite differences and the float64 reference.
SINGLE, DIFFERENCES, DOUBLE = 1e-5, 2e-6, 1e-10


@dataclass(frozen=True)
class Letters:
    """The names of a layer's blobs in its docstring, each with its axes, such as "n c h w"."""

    bottoms: Mapping[str, str]
    tops: Mapping[str, str]
    params: Mapping[str, str] = field(default_factory=dict)

    def all_axes(self) -> dict[str, str]:
        """Return the axes of each result: a blob's data, its diff, its data after forward."""
        axes = {**self.bottoms, **self.tops, **self.params}
        diffs = {f"d{name}": axes[name] for name in axes}
        return axes | diffs | {_after_forward(name): axes[name] for name in axes}


def _after_forward(bottom: str) -> str:
    return f"{bottom} (after forward)"


@dataclass(frozen=True, eq=False)
class Example:
    """A layer with its inputs, which avoid points where it is not differentiable
    unless ``on_kinks``.

    options   the fields of its block, or of its ``layer { ... }`` except the type
    bottoms   the data of each bottom, unless ``caffe``
    caffe     name of the recorded case that holds the inputs, parameters and Caffe's results
    tops      number of tops
    on_kinks  do not compare the gradient with finite differences, only with the reference layer's
    """

    options: str = ""
    bottoms: tuple[Array, ...] = ()
    caffe: str = ""
    tops: int = 1
    phase: Phase = "TRAIN"
    in_place: bool = False
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


class Option:
    """An option of a layer, checked in a step of its own: its title and hint as in Check."""

    def __init__(self, title: str, hint: str, *examples: Example) -> None:
        self.title, self.hint, self.examples = title, hint, examples


def numbers(*shape: int, seed: int = 0) -> Array:
    """Return random values of both signs with magnitudes from 0.2 to 1, away from 0."""
    rng = np.random.default_rng(seed)
    return rng.choice([-1.0, 1.0], shape) * rng.uniform(0.2, 1, shape)


@dataclass(frozen=True)
class _Runner:
    """Runs the layer of a part on an example. The results have the names of ``letters``.

    type_name  of the layer, which is also the name of its class
    shaped_by  the method that sets the tops' shapes
    reference  a part with the project's class
    """

    type_name: str
    letters: Letters
    shaped_by: str
    reference: Part
    example: Example

    def build(self, part: Part) -> tuple[Layer, Blobs, Blobs]:
        """Return the layer with its bottoms, filled, and its tops, which have their shapes."""
        example = self.example
        dtype = np.float32 if example.caffe else np.float64
        params = recorded.of_layer(example.caffe, "param")
        with replaced(LAYER_TYPES, self.type_name, getattr(part, self.type_name)):
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
        tops = [bottom[0]] if example.in_place else [Blob((), dtype) for _ in range(example.tops)]
        top = Blobs(tops, dtype)
        layer.reshape(bottom, top)
        return layer, bottom, top

    def shapes(self, part: Part) -> Values:
        """Return tops of zeros."""
        _, _, top = self.build(part)
        return {name: np.zeros(blob.shape) for name, blob in zip(self.letters.tops, top)}

    def values(self, part: Part) -> Values:
        """Run forward with tops initialized to NaN; returns the tops, then the bottoms, which
        must not change. In place, the bottom is the top.
        """
        layer, bottom, top = self.build(part)
        if not self.example.in_place:
            for blob in top:
                blob.data[...] = np.nan
        layer.forward(bottom, top)
        tops = zip(self.letters.tops, top)
        bottoms = zip(map(_after_forward, self.letters.bottoms), bottom)
        return {name: blob.data.copy() for name, blob in [*tops, *bottoms]}

    def gradients(self, part: Part) -> Values:
        """Return the gradients of a weighted sum of the tops, by backward."""
        return self._by_letter(gradient.analytic for gradient in self._checked(part))

    def differences(self, part: Part) -> Values:
        """Return the gradients of the same sum, by finite differences of forward."""
        return self._by_letter(gradient.differences() for gradient in self._checked(part))

    def _checked(self, part: Part) -> Iterator[gradcheck.Gradient]:
        layer, _, _ = self.build(part)
        example = self.example
        return gradcheck.gradients(layer, example.inputs, example.tops, in_place=example.in_place)

    def second(self, part: Part, skipped: int | None = None) -> Values:
        """Run a larger batch, then the example; returns the data and diffs of all blobs.

        ``skipped`` is the number of a bottom without propagate_down.
        Diffs of parameters are 0 before each; top diffs are those recorded, if any.
        """
        layer, bottom, top = self.build(part)
        dys = recorded.of_layer(self.example.caffe, "topdiff") or [numbers(97)] * len(top)
        for times, sign in ((2, -1), (1, 1)):
            for blob, array in zip(bottom, self.example.inputs):
                blob.reshape(times * len(array), *array.shape[1:])
                blob.data[...] = sign * np.resize(array, blob.shape)
            layer.reshape(bottom, top)
            layer.forward(bottom, top)
            for blob in layer.blobs:
                blob.diff[...] = 0
            for blob, dy in zip(top, dys):
                blob.diff[...] = np.resize(dy, blob.shape)
            layer.backward(top, [i != skipped for i in range(len(bottom))], bottom)
        names = self.letters
        blobs = [*zip(names.tops, top), *zip(names.bottoms, bottom)]
        blobs += zip(names.params, layer.blobs)
        data = {name: blob.data for name, blob in blobs}
        return data | {f"d{name}": blob.diff for name, blob in blobs}

    def _by_letter(self, gradients: Iterable[Array]) -> Values:
        """Return gradients of the bottoms, then of the parameters, by name."""
        bottoms = [*self.letters.bottoms][: len(self.example.inputs)]
        names = [*bottoms, *self.letters.params]
        return {f"d{name}": array for name, array in zip(names, gradients)}

    def case(
        self,
        method: str,
        run: Callable[[Part], Values],
        wanted: Callable[[Part], Values],
        source: str,
        tolerance: float,
        hint: str = "",
    ) -> Case:
        """Return a case of this example; the arguments are fields of Case, but ``wanted`` is
        called with the reference.
        """
        return Case(
            self.example.title,
            run,
            lambda: wanted(self.reference),
            source,
            self.letters.all_axes(),
            tolerance,
            method,
            hint,
        )

    def cases(self) -> Iterator[Case]:
        """Yield the cases: the shapes, forward, and backward unless its gradient is not checked."""
        yield self.case(self.shaped_by, self.shapes, self.shapes, "expected", 0)
        yield from self._against_caffe() if self.example.caffe else self._against_reference()

    def _against_caffe(self) -> Iterator[Case]:
        top, bottom_diffs, param_diffs = (
            recorded.of_layer(self.example.caffe, kind) for kind in ("top", "indiff", "pdiff")
        )
        tops = dict(zip(self.letters.tops, top))
        diffs = self._by_letter(bottom_diffs + param_diffs)
        yield self.case("forward", self.values, lambda _: tops, "Caffe has", SINGLE)
        yield self.case("backward", self.second, lambda _: diffs, "Caffe has", SINGLE)

    def _against_reference(self) -> Iterator[Case]:
        yield self.case("forward", self.values, self.values, REFERENCE, DOUBLE)
        hint = ""
        if not self.example.on_kinks:
            hint, source = AGAIN, "finite differences give"
            yield self.case("backward", self.gradients, self.differences, source, DIFFERENCES)
        yield self.second_case(hint)

    def second_case(self, hint: str, skipped: int | None = None) -> Case:
        """Return the case of a second batch, compared with the reference layer."""
        run = functools.partial(self.second, skipped=skipped)
        return self.case("backward", run, run, REFERENCE, DOUBLE, hint)


def _cases(runners: Iterable[_Runner]) -> tuple[Case, ...]:
    return tuple(case for runner in runners for case in runner.cases())


def _checks_without_options(runners: Sequence[_Runner]) -> list[Check]:
    """Return the checks of the shapes, of forward and of backward."""
    source = "Caffe" if any(runner.example.caffe for runner in runners) else "the reference"
    titles = {
        runners[0].shaped_by: "shapes",
        "forward": f"values: forward agrees with {source}",
        "backward": f"gradient: backward agrees with finite differences and with {source}",
    }
    cases = _cases(runners)
    return [
        Check(title, tuple(case for case in cases if case.method == method))
        for method, title in titles.items()
    ]


def layer_exercise(
    type_name: str,
    *,
    title: str,
    chapter: int,
    block: str = "",
    to_do: Mapping[str, str],
    letters: Letters,
    examples: Sequence[Example],
    options: Sequence[Option] = (),
    mistakes: tuple[Mistake, ...],
    shaped_by: str = "reshape",
) -> Exercise:
    """Return the exercise for a layer, with the name and the source of its file.

    block      the field of a layer that has its options, such as relu_param
    to_do      maps its methods to instructions
    examples   of the layer without options
    options    in the order in which a reader adds them
    shaped_by  the method that sets the tops' shapes
    """

    cls = LAYER_TYPES[type_name]
    reference = SimpleNamespace(**{type_name: cls})

    def runner(example: Example) -> _Runner:
        """Return the runner of an example, with its options in the block."""
        if block and example.options:
            example = dataclasses.replace(example, options=f"{block} {{ {example.options} }}")
        return _Runner(type_name, letters, shaped_by, reference, example)

    def train(part: Part, iterations: int) -> Array:
        with replaced(LAYER_TYPES, type_name, getattr(part, type_name)):
            return network.losses(iterations)

    checks = _checks_without_options([runner(example) for example in examples])
    for option in options:
        cases = _cases(runner(example) for example in option.examples)
        checks.append(Check(f"with {option.title}", cases, option.title, option.hint))
    first = runner(examples[0])
    not_down = tuple(first.second_case(LEAVE, i) for i in range(len(letters.bottoms)))
    checks.append(Check(f"with {NOT_DOWN}", not_down, NOT_DOWN))
    file = PurePosixPath(*cls.__module__.split(".")).with_suffix(".py")
    return Exercise(
        name=file.stem,
        title=title,
        chapter=chapter,
        file=str(file),
        to_do={f"{type_name}.{method}": task for method, task in to_do.items()},
        checks=tuple(checks),
        mistakes=mistakes,
        train=train,
    )
