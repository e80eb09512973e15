"""The exercise to write a layer, and the mistakes that any layer may have."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from exercises import network
from exercises.exercise import Exercise, Mistake, Part, Remedy, Tell
from exercises.layer_checks import checks
from exercises.layer_examples import Example, Letters
from layers import LAYER_TYPES
from netlib.blob import Array, Blobs
from netlib.layer import Layer


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
