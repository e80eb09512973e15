"""Checks of a layer: shapes, values and gradients, on small examples and on Caffe's recorded results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from exercises import recorded
from exercises.exercise import Case, Check, Part, Values
from exercises.layer_examples import Example, Letters, backward, built, forward, gradients_of
from netlib.layer import Layer

SINGLE, DIFFERENCES, DOUBLE = 1e-5, 2e-6, 1e-10  # tolerances: Caffe's float32, finite differences, float64 reference


def checks(
    type_name: str,
    letters: Letters,
    examples: Sequence[Example],
    from_caffe: Mapping[str, Example],
    reference: type[Layer],
    shaped_by: str,
) -> tuple[Check, ...]:
    """Return the steps of a layer. ``from_caffe`` names recorded cases; only the options of their examples are used."""
    axes = letters.all_axes()
    recorded_examples = {name: _as_recorded(name, example) for name, example in from_caffe.items()}
    shapes, values, gradients = [], [], []

    for example in examples:

        def shape(part: Part, example: Example = example) -> Values:
            run = built(part, type_name, example, np.float64)
            return {name: np.zeros(blob.shape) for name, blob in zip(letters.tops, run.top)}

        def value(part: Part, example: Example = example) -> Values:
            return forward(built(part, type_name, example, np.float64), letters, example)

        def gradient(part: Part, example: Example = example) -> Values:
            return {name: g.analytic for name, g in gradients_of(part, type_name, example, letters)}

        def differences(example: Example = example) -> Values:
            return {name: g.differences() for name, g in gradients_of(reference, type_name, example, letters)}

        shapes.append(Case(example.title, shape, _by(shape, reference), "expected", axes, 0, shaped_by))
        values.append(
            Case(example.title, value, _by(value, reference), "the reference layer has", axes, DOUBLE, "forward")
        )
        if example.on_kinks:

            def slope(part: Part, example: Example = example) -> Values:
                run = built(part, type_name, example, np.float64)
                return backward(run, [np.full(blob.shape, 0.5) for blob in run.top], letters)

            gradients.append(
                Case(example.title, slope, _by(slope, reference), "the reference layer has", axes, DOUBLE, "backward")
            )
        elif example.gradient:
            gradients.append(Case(example.title, gradient, differences, "finite differences give", axes, DIFFERENCES,
                                  "backward"))
    caffes_values, caffes_gradients = [], []
    for name, example in recorded_examples.items():

        def caffe_value(part: Part, example: Example = example) -> Values:
            return forward(built(part, type_name, example, np.float32), letters, example)

        def caffe_gradient(part: Part, name: str = name, example: Example = example) -> Values:
            return backward(built(part, type_name, example, np.float32), recorded.of_layer(name, "topdiff"), letters)

        tops = dict(zip(letters.tops, recorded.of_layer(name, "top")))
        diffs = dict(zip([f"d{x}" for x in letters.bottoms], recorded.of_layer(name, "indiff")))
        diffs |= dict(zip([f"d{x}" for x in letters.params], recorded.of_layer(name, "pdiff")))
        caffes_values.append(Case(example.title, caffe_value, _given(tops), "Caffe has", axes, SINGLE, "forward"))
        caffes_gradients.append(
            Case(example.title, caffe_gradient, _given(diffs), "Caffe has", axes, SINGLE, "backward")
        )
    return (
        Check("shapes", tuple(shapes)),
        Check("values: forward agrees with Caffe", tuple(values + caffes_values)),
        Check("gradient: backward agrees with finite differences and with Caffe",
              tuple(gradients + caffes_gradients)),
    )


def _by(run: Any, reference: Part) -> Any:
    return lambda: run(reference)


def _given(values: Values) -> Any:
    return lambda: values


def _as_recorded(name: str, example: Example) -> Example:
    bottoms, params = recorded.of_layer(name, "in"), recorded.of_layer(name, "param")
    return Example(example.options, tuple(bottoms), example.tops, example.phase, params=tuple(params))
