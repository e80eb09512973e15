"""Layer exercises, and the mistakes that any layer can contain."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from exercises import network
from exercises.exercise import Exercise, Mistake, Part, Progress, Remedy
from exercises.layer_checks import checks
from exercises.layer_examples import Example, Letters
from layers import LAYER_TYPES
from netlib.blob import Array, Blobs
from netlib.layer import Layer


def _clears(part: type[Layer]) -> type[Layer]:
    class Clears(part):  # type: ignore[valid-type,misc]
        """Zeroes the bottom diffs before backward."""

        def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
            for blob in bottom:
                if not any(blob is other for other in top):
                    blob.diff[...] = 0
            super().backward(top, propagate_down, bottom)

    return Clears


def _adds(part: type[Layer]) -> type[Layer]:
    class Adds(part):  # type: ignore[valid-type,misc]
        """Adds the parameter gradients of backward to the previous diffs."""

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
        "backward adds to the diff of a bottom. It must assign, bottom[0].diff[...] = ...: the diff is not cleared and "
        "contains old values, here NaN.",
        lambda got: bool(np.isnan(got).all()),
    ),
    Remedy(
        _clears,
        "backward leaves some elements of the diff of a bottom unchanged. It must write every element, also zeros: "
        "the diff is not cleared and contains old values, here NaN.",
        lambda got: bool(np.isnan(got).any()),
    ),
    Remedy(
        _adds,
        "backward overwrites the diff of a parameter. It must add, with +=: the diff accumulates the gradients of "
        "several batches and of layers that share the parameter.",
    ),
)


@contextlib.contextmanager
def in_place_of(type_name: str, part: type[Layer]) -> Iterator[None]:
    """Make nets use this class for layers of the type."""
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
    """Return the exercise for a layer; ``to_do`` maps its methods to instructions, ``shaped_by`` is the method that
    sets the tops' shapes.
    """
    reference = LAYER_TYPES[type_name]
    cls = reference.__name__

    def train(part: Part, iterations: int, progress: Progress) -> Array:
        with in_place_of(type_name, part):
            return network.losses(iterations, progress)

    return Exercise(
        name=name,
        title=title,
        chapter=chapter,
        file=file,
        to_do={f"{cls}.{method}": task for method, task in to_do.items()},
        names=tuple(f"{cls}.{method}" for method in ("setup", "reshape", "forward", "backward")),
        part_of=lambda module: getattr(module, cls),
        reference=reference,
        checks=checks(type_name, letters, examples, from_caffe, reference, shaped_by),
        mistakes=tuple(mistakes),
        train=train,
        remedies=REMEDIES,
    )
