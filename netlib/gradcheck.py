"""Check a layer's backward against central differences.

    from netlib import gradcheck
    layer = gradcheck.make_layer('type: "ReLU"', [x])
    gradcheck.check(layer, [x])                         what was checked, or a GradientError

A layer maps bottoms and parameters to tops. With random weights dy on the tops, the number L = sum
of dy · y is a function of every bottom and parameter value; backward must give its gradient. Each
value v is moved by ±step:

    dL/dv  ≈  (L(v + step) - L(v - step)) / (2 step)

Everything runs in float64. The layer's random generator is reset before each forward, so that
dropout draws the same mask. Inputs should be farther than the step from kinks
(of ReLU, of a maximum). Bottom diffs start as NaN and parameter diffs as ones, so a backward that
skips an element, or overwrites where it must add, fails.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from netlib import engine as engines
from netlib.blob import Array, Blob, Blobs
from netlib.building.create import create
from netlib.layer import Layer
from netlib.proto import prototxt, schema
from netlib.proto.messages import LayerParameter
from netlib.proto.schema import Phase

STEP = 1e-6  # by which a value is moved
COARSE = 1 << 10  # multiples of 1/COARSE occur by themselves: whole numbers, halves
KINK = 1e-3  # part of a one-sided difference by which the two disagree at a kink
UNNAMED = "layer"  # name of a layer of which the text has none


class GradientError(AssertionError):
    """A gradient that does not agree with the central differences."""


class Gradient(NamedTuple):
    """The gradient with respect to one bottom or parameter."""

    kind: str  # "bottom" or "parameter"
    number: int
    analytic: Array  # computed by backward
    # computes the central differences: two forward passes per value
    differences: Callable[[], Array]
    # why the central difference at a place may be wrong, or an empty string
    doubt: Callable[[tuple[int, ...]], str]


class Checked(NamedTuple):
    """What ``check`` compared: its repr names the bottoms and parameters with their shapes.

    differences  largest difference of each, relative to its largest gradient
                 (or to 1, if that is larger)
    """

    differences: dict[str, float]
    tolerance: float

    def __repr__(self) -> str:
        """Name what agrees."""
        if not self.differences:
            return "no gradient was wanted, and there are no parameters: nothing was checked"
        return f"backward agrees with central differences to {self.tolerance:g}: {', '.join(self.differences)}"


def make_layer(
    text: str,
    bottoms: Sequence[ArrayLike],
    tops: int = 1,
    phase: Phase = "TRAIN",
    engine: str | None = None,
    dtype: DTypeLike = np.float64,
) -> Layer:
    """Build a layer from the text inside ``layer { ... }`` and set it up for bottoms
    of these shapes.

    The default ``engine``, unless NETLIB_ENGINE is set, is "plain": the class in layers/. "fast" is
    its class in fast/.
    """
    spec = schema.read(prototxt.parse(text, "<gradcheck>"), LayerParameter)
    names = [f"bottom{i}" for i in range(len(bottoms))]
    changes: dict[str, Any] = {
        "name": spec.name or UNNAMED,
        "bottom": tuple(names),
        "top": tuple(f"top{i}" for i in range(tops)),
    }
    spec = schema.changed(spec, **changes)
    chosen = engines.get(engine, default="plain")
    layer = create(spec, phase, np.random.default_rng(0), dtype, chosen.implementation)
    layer.setup(_blobs(bottoms), _empty(tops))
    return layer


def check(
    layer: Layer,
    bottoms: Sequence[ArrayLike],
    tops: int = 1,
    wanted: Sequence[bool] | None = None,
    tolerance: float = 1e-6,
    in_place: bool = False,
) -> Checked:
    """Raise GradientError unless backward agrees with central differences; returns
    what was compared.

    wanted      the bottoms to check; default all
    tolerance   maximum difference, relative to the largest gradient of the same array
                (or to 1, if that is larger)
    in_place    make the first top the same blob as the first bottom, as in a net where they
                have the same name
    """
    found: dict[str, float] = {}
    for gradient in gradients(layer, bottoms, tops, wanted, in_place):
        what = f"{gradient.kind} {gradient.number}"
        error = _compare(f"{_described(layer)}: gradient of {what}", gradient, tolerance)
        found[f"{what} {gradient.analytic.shape}"] = error
    return Checked(found, tolerance)


def gradients(
    layer: Layer,
    bottoms: Sequence[ArrayLike],
    tops: int = 1,
    wanted: Sequence[bool] | None = None,
    in_place: bool = False,
) -> Iterator[Gradient]:
    """Yield the gradients that ``check`` compares: those of the wanted bottoms, then those of
    the parameters.
    """
    wanted = [True] * len(bottoms) if wanted is None else list(wanted)
    rng = np.random.default_rng(0)
    start = layer.state()

    def run(values: Sequence[Array]) -> tuple[Blobs, Blobs]:
        layer.restore(start)
        bottom = _blobs(values)
        top = _empty(tops)
        if in_place:
            top[0] = bottom[0]
        layer.reshape(bottom, top)
        layer.forward(bottom, top)
        return bottom, top

    arrays = [np.array(x, dtype=np.float64) for x in bottoms]
    bottom, top = run(arrays)
    weights = [rng.uniform(0.5, 1.5, y.shape) * rng.choice([-1.0, 1.0], y.shape) for y in top]

    def tops_now() -> list[Array]:
        """The tops of the present values, until the next run."""
        return [y.data for y in run(arrays)[1]]

    def value() -> float:
        """L of the present values."""
        return float(sum((w * y).sum() for w, y in zip(weights, tops_now())))

    def gradient(kind: str, number: int, analytic: Array, array: Array) -> Gradient:
        differences = partial(_differences, array, value)
        doubt = partial(_doubt, array, value, tops_now)
        return Gradient(kind, number, analytic, differences, doubt)

    # backward must overwrite the NaN of bottoms, and add to the ones of parameters
    for blob in bottom:
        blob.diff[...] = np.nan
    for param in layer.blobs:
        param.diff[...] = 1
    for w, y in zip(weights, top):
        y.diff[...] = w
    layer.backward(top, wanted, bottom)
    for i, (blob, array) in enumerate(zip(bottom, arrays)):
        if wanted[i]:
            yield gradient("bottom", i, blob.diff.copy(), array)
    for i, param in enumerate(layer.blobs):
        yield gradient("parameter", i, param.diff - 1, param.data)


def _differences(array: Array, value: Callable[[], float]) -> Array:
    """Central differences of ``value`` with respect to every element of ``array``."""
    numeric = np.zeros(array.shape)
    for index in np.ndindex(*array.shape):
        original = array[index]
        array[index] = original + STEP
        above = value()
        array[index] = original - STEP
        below = value()
        array[index] = original
        numeric[index] = (above - below) / (2 * STEP)
    return numeric


def _doubt(
    array: Array,
    value: Callable[[], float],
    tops: Callable[[], list[Array]],
    place: tuple[int, ...],
) -> str:
    """Why the difference at a place may be wrong: tops rounded to float32, or a kink
    within the step.

    ``tops`` computes the tops of the present values.

    At a kink the differences to the left and to the right disagree. With a tenth of the step, their
    disagreement is unchanged if the kink is at the value itself, and vanishes if it is farther
    away; for a smooth function it is a tenth.
    """
    original = array[place]
    middle = value()

    def sides(distance: float) -> tuple[float, float]:
        found = []
        for moved in (-distance, distance):
            array[place] = original + moved
            found.append((value() - middle) / moved)
        array[place] = original
        return found[0], found[1]

    array[place] = original + STEP * np.pi  # no float32
    values = np.concatenate([y.ravel() for y in tops()])
    array[place] = original
    fractions = values[values * COARSE % 1 != 0]  # others are exact in float32, too
    if fractions.size and (fractions == fractions.astype(np.float32)).all():
        return (
            "the tops are rounded to float32, which is too coarse for the differences: compute in the dtype of the "
            "bottoms, float64 here"
        )
    (left, right), (near_left, near_right) = sides(STEP), sides(STEP / 10)
    apart = abs(right - left)
    near_apart = abs(near_right - near_left)
    is_smooth = apart / 20 < near_apart < apart / 5
    if apart > KINK * max(abs(left), abs(right)) and not is_smooth:
        return (
            f"the difference to the left is {left:.3g}, to the right {right:.3g}, so there is a kink within "
            f"{STEP:g} of the value {original:.9g}: move it away from there"
        )
    return ""


def _compare(what: str, gradient: Gradient, tolerance: float) -> float:
    """The largest difference of a gradient, relative to its scale.

    Raises GradientError if it is too large.
    """
    analytic = gradient.analytic
    numeric = gradient.differences()
    if analytic.size == 0:
        return 0.0
    error = np.array(np.abs(analytic - numeric))
    error[~np.isfinite(analytic)] = np.inf
    worst = np.unravel_index(int(error.argmax()), error.shape)
    scale = max(1.0, float(np.abs(numeric).max()))
    if not error[worst] <= tolerance * scale:
        place = tuple(map(int, worst))
        doubt = gradient.doubt(place) if np.isfinite(analytic[worst]) else ""
        raise GradientError(
            f"{what} at {place}: backward computed {analytic[worst]:.9g}, central differences give "
            f"{numeric[worst]:.9g}{doubt and f'; {doubt}'}"
        )
    return float(error[worst] / scale)


def _described(layer: Layer) -> str:
    """The class of a layer, with its name if it has one: ``layer 'square' (Square)``."""
    kind = type(layer).__name__ if layer.type == "Python" else layer.type
    return kind if layer.name == UNNAMED else f"layer {layer.name!r} ({kind})"


def _blobs(arrays: Sequence[ArrayLike]) -> Blobs:
    blobs = Blobs(dtype=np.float64)
    for array in arrays:
        values = np.asarray(array, dtype=np.float64)
        blobs.append(Blob(values.shape, np.float64))
        blobs[-1].data[...] = values
    return blobs


def _empty(count: int) -> Blobs:
    return Blobs([Blob((), np.float64) for _ in range(count)], np.float64)
