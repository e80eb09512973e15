"""Steps on the whole batch: one layer, or a layer and those that it computes (fusing.py).

    convolution: a -> b     BatchNorm: b -> c     Scale, ReLU: c -> c

If only these layers use b, the convolution writes c, and b is *unstored*. It can be computed from
``a`` and the parameters of the convolution, the *sources*, as long as these have the values of the
pass. Copying them in each pass would take longer than fusing saves. A source is copied only if a
caller can write it: when the pass ends if a caller has an array of it, otherwise before a caller
gets one (``keep``).
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import dataclass, field

from fast.fast_layer import is_fused
from fast.last_pass import DATA, Copies, LastPass
from fast.plan import Run
from netlib.blob import Blob
from netlib.engine import Connection, Missing, Step, versions_of


class FastStep(Step):
    """A step of the fast engine."""

    @property
    def key(self) -> tuple[object, ...]:
        """What makes two steps of one net equal."""
        return type(self), self.at


class WholeStep(FastStep):
    """One layer, run on the whole batch.

    Layers of this project are reshaped only after a shape has changed.
    """

    def __init__(self, at: Connection) -> None:
        super().__init__(at)
        # The reshape of a Python layer may depend on more than shapes.
        self._is_steady = at.layer.type != "Python"
        # Versions of the blobs after the last reshape of the layer.
        self._reshaped: tuple[int, ...] | None = None

    def forward(self) -> None:
        """Reshape the tops if necessary and compute them."""
        at = self.at
        with at.errors:
            self.reshape()
            at.layer.forward(at.bottom, at.top)

    def reshape(self) -> None:
        """Reshape the tops if the shape of a blob has changed."""
        at = self.at
        if not self._is_steady or self._reshaped != versions_of(at.blobs):
            at.layer.reshape(at.bottom, at.top)
            self._reshaped = versions_of(at.blobs)


@dataclass
class Reading:
    """What a fused step read in its last pass.

    shapes    of the blobs of the layers that write unstored blobs
    versions  of the blobs that these layers read
    copies    values of sources; None: a caller may have written sources since
    is_done   whether the pass is complete
    """

    shapes: dict[Blob, tuple[int, ...]] = field(default_factory=dict)
    versions: tuple[int, ...] = ()
    copies: Copies | None = None
    is_done: bool = False

    def forget(self) -> None:
        """Note that what was read is being written."""
        self.copies, self.is_done = None, False


class FusedStep(FastStep):
    """A layer and those behind it that it computes, run on the whole batch.

    reading  what was read in the last pass; None if none has begun

    ``blobs`` are those of the net.
    """

    def __init__(self, connections: list[Connection], blobs: Set[Blob]) -> None:
        first, last = connections[0], connections[-1]
        super().__init__(first)
        self.connections = connections
        self._by_layer = [WholeStep(at) for at in connections]
        self._run = Connection(
            first.layer, first.bottom, last.top, first.propagate_down, first.needs_backward
        )
        tops = dict.fromkeys(blob for at in connections for blob in at.top)
        self.unstored = [blob for blob in tops if blob not in last.top]
        writers = [at for at in connections if at.top[0] in self.unstored]
        self._writers = Run(writers, writers, self.unstored, {}, sliced=False)
        # Maps what a writer reads to the source that has its values.
        self._read = {param: param for at in writers for param in at.layer.blobs}
        for blob in first.bottom if writers else []:
            self._read[blob] = blob.root if blob.root in blobs else blob
        self.sources = list(dict.fromkeys(self._read.values()))
        self.reading: Reading | None = None

    @property
    def key(self) -> tuple[object, ...]:
        """The layers, and the memory of what they read."""
        return FusedStep, *self.connections, *self.unstored, *self.sources

    def begin(self) -> None:
        """Forget the last pass, because other steps write what it has read."""
        if self.reading is not None:
            self.reading.forget()

    def forward(self) -> None:
        """Reshape the tops of all layers if necessary, and compute those of the last."""
        reading = self.reading = self.reading or Reading()
        reading.forget()
        for step in self._by_layer:
            with step.at.errors:
                step.reshape()
        with self.at.errors:
            self._run.layer.forward(self._run.bottom, self._run.top)
        reading.shapes = {blob: blob.shape for at in self._writers.connections for blob in at.blobs}
        reading.versions = versions_of(self._read)
        reading.is_done = True

    def finish(self) -> None:
        """Copy the sources of which a caller has an array."""
        reading = self.reading
        if reading is not None and reading.is_done and reading.copies is None:
            held = [blob for blob in self.sources if blob.is_held]
            reading.copies = {blob: blob.unwatched_data.copy() for blob in held}

    def keep(self, source: Blob) -> None:
        """Copy a source before a caller gets an array of it."""
        copies = self.reading.copies if self.reading else None  # another thread may begin a pass
        if copies is not None and source not in copies:
            copies[source] = source.unwatched_data.copy()

    def backward(self, at_once: bool = False) -> None:
        """Compute the diffs, layer by layer."""
        for step in reversed(self._by_layer):
            step.backward(at_once)

    def pieces(self) -> list[list[Connection]]:
        """The layers in execution order."""
        return [[self._run, *self.connections[1:]]]

    def store(self) -> Missing:
        """Store the unstored blobs with their values in the last pass.

        A source that was reshaped without a copy has lost them.
        """
        if not self.unstored or self.reading is None:
            return Missing({})
        last_pass = LastPass(self._writers, shapes=self.reading.shapes)
        values = self._values(self.reading)
        if last_pass.is_discarded():
            return Missing({}, self.connections)
        if not values:
            return Missing(dict.fromkeys(self.unstored, DATA), self.connections)
        last_pass.take(values)
        return last_pass.store()

    def _values(self, reading: Reading) -> Copies:
        """What the last pass read, as far as it is known: all or nothing."""
        values: Copies = {}
        if reading.copies is None:
            return values
        for (blob, source), version in zip(self._read.items(), reading.versions):
            if source in reading.copies:
                values[blob] = reading.copies[source]
            elif blob.version == version:
                values[blob] = source.unwatched_data
            else:
                return {}
        return values


def whole_steps(connections: Sequence[Connection], blobs: Set[Blob]) -> list[FastStep]:
    """The steps of layers on the whole batch, in a net with these blobs."""
    groups: list[list[Connection]] = []
    for at in connections:
        if is_fused(at.layer):
            groups[-1].append(at)
        else:
            groups.append([at])
    return [FusedStep(group, blobs) if len(group) > 1 else WholeStep(group[0]) for group in groups]
