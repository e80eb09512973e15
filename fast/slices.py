"""Run layers slice by slice: a few images at a time, one slice per thread.

The first convolution of the paper's network writes 252 MB for a batch of 512, and every layer that
uses such a blob is limited by main memory. A sequence of *batchwise* layers
(item n of a top depends only on item n of the bottoms) therefore runs on one slice of the batch
after the other, so that the blobs of a slice stay in the processor's cache. division.py makes the
slices and assigns them to lanes.

The slices of a lane run one after the other, and add to the same parameter gradients. A free thread
runs the next lane. The gradients of the lanes are summed in order, so results do not depend on the
number of threads:

    dw = dw(lane 0) + dw(lane 1) + ...
"""

from __future__ import annotations

from functools import partial

from fast import parallel
from fast.division import Division, Lane
from fast.fast_layer import is_fused
from fast.last_pass import LastPass
from fast.plan import Run
from fast.whole_steps import FastStep, whole_steps
from netlib.blob import Blob
from netlib.engine import Connection, Missing
from netlib.errors import NetlibError

# numbers of items whose division is kept, without a backward pass: a caller's batches vary
RECENT = 4

Shapes = tuple[tuple[int, ...], ...]


class SlicedStep(FastStep):
    """Several consecutive layers, run slice by slice.

    If some blobs have other numbers of items than the others, because a layer before them, such as
    a Filter, has dropped items, the layers run on the whole batch from then on.
    """

    def __init__(self, run: Run) -> None:
        super().__init__(run.connections[0])
        self.run, self.connections, self.unstored = run, run.connections, run.unstored
        self._division = Division(run)
        self._lanes: list[Lane] = []
        # the lanes for recent shapes of all blobs, the present ones last
        self._recent: dict[Shapes, list[Lane]] = {}
        # the steps that run instead of the lanes once the layers run on the whole batch
        self._whole: list[FastStep] = []
        self._is_done = False  # whether the slices have the state of a complete forward pass
        self.last = LastPass(run) if self._is_recorded() else None
        self._outputs, down = run.written(), run.differentiated()
        self._blobs = list(dict.fromkeys(b for at in run.connections for b in at.blobs))
        self._gradients = [b for b in run.read() if b in down] + self._outputs  # whose diff is used
        self._user = {b: at for at in reversed(run.connections) for b in at.blobs}

    def _is_recorded(self) -> bool:
        """Whether values of a pass may be needed that the pass does not store: blobs, or
        what layers keep.
        """
        reads_kept = any(at.layer.reads_kept for at in self.connections)
        return bool(self.unstored) or (self._division.needs_backward and reads_kept)

    @property
    def key(self) -> tuple[object, ...]:
        """The run."""
        return SlicedStep, *self.run.key

    def has_state(self) -> bool:
        """Whether the last forward pass of the slices is complete."""
        return self._is_done

    def prepare(self) -> None:
        """Divide the batch into slices unless this was done for the current shapes."""
        if self._whole or self._is_divided():
            return
        for at in self.connections:
            with at.errors:
                at.layer.reshape(at.bottom, at.top)
        if len({blob.shape[:1] for blob in self._blobs}) > 1:
            self._run_whole()
            return
        lanes = self._division.lanes(items=self.at.bottom[0].shape[0])
        kept = [] if self._division.needs_backward else [*self._recent.items()][1 - RECENT :]
        self._lanes, self._recent = lanes, dict([*kept, (self._shapes(), lanes)])

    def _is_divided(self) -> bool:
        """Whether there are slices for the current shapes; those of a recent batch become the
        present ones.
        """
        shapes = self._shapes()
        lanes = self._recent.get(shapes, [])
        if lanes and lanes is not self._lanes:
            self._lanes = self._recent[shapes] = self._recent.pop(shapes)
        return bool(lanes)

    def _shapes(self) -> Shapes:
        return tuple(blob.shape for blob in self._blobs)

    def _run_whole(self) -> None:
        """Run the layers on the whole batch from now on."""
        self.lost = self.store()
        whole = whole_steps(self.connections, set(self._blobs))
        self.sources = [blob for step in whole for blob in step.sources]
        unstored = [blob for step in whole for blob in step.unstored]
        # in one statement, so that an interrupt leaves all of them or none
        self._whole, self._lanes, self.unstored, self.last = whole, [], unstored, None

    def pieces(self) -> list[list[Connection]]:
        """The layers of every slice in execution order."""
        self.prepare()
        if self._whole:
            return [[step.at] for step in self._whole]
        return [piece.connections for lane in self._lanes for piece in lane]

    def forward(self) -> None:
        """Run the layers forwards on all slices."""
        self._is_done = False
        if self.last is not None:
            self.last.begin()
        for blob in self._outputs:
            with self._user[blob].errors:
                blob.data  # noqa: B018 - allocates here, not on several threads at once
        parallel.run([partial(self._forward, lane) for lane in self._lanes])
        for step in self._whole:
            step.forward()
        self._is_done = True
        if self.last is not None:
            self.last.finish()

    def _forward(self, lane: Lane) -> None:
        for piece in lane:
            if self.last is not None:
                self.last.copy_inputs(piece.rows)
            for at in piece.connections:
                if not is_fused(at.layer):
                    with at.errors:
                        at.layer.forward(at.bottom, at.top)

    def backward(self, at_once: bool = False) -> None:
        """Run the layers backwards on all slices, and sum the gradients of the parameters.

        Unless it is ``at_once``, raises NetlibError if a caller has written an input since forward.
        """
        if not self._division.needs_backward:
            return
        for step in reversed(self._whole):
            step.backward()
        if self.last is not None:
            self.last.begin_backward(at_once)
        for blob in self._gradients:
            with self._user[blob].errors:
                blob.diff  # noqa: B018
        parallel.run([partial(self._backward, lane, at_once) for lane in self._lanes])
        for i, at in enumerate(self.run.order):
            for j, param in enumerate(at.layer.blobs):
                for lane in self._lanes:
                    param.diff[...] += lane[0].connections[i].layer.blobs[j].diff
        if self.last is not None:
            self.last.finish_backward()

    def _backward(self, lane: Lane, at_once: bool) -> None:
        for at in lane[0].connections:
            for param in at.layer.blobs:
                param.diff[...] = 0
        for piece in lane:
            if self.last is not None:
                self.last.copy_top_diffs(piece.rows)
                if not at_once and (blob := self.last.written_input(piece.rows)):
                    raise self._written(blob)
            for at in reversed(piece.connections):
                if at.needs_backward:
                    with at.errors:
                        at.layer.backward(at.top, at.propagate_down, at.bottom)

    def store(self) -> Missing:
        """Store the unstored blobs of the last pass, and let the layers keep what they
        need for backward.
        """
        if self.last is not None:
            return self.last.store()
        missing = [self.lost or Missing({}), *(step.store() for step in self._whole)]
        halves = {blob: half for part in missing for blob, half in part.halves.items()}
        return Missing(halves, [at for part in missing for at in part.layers])

    def begin(self) -> None:
        """Forget the last pass of layers that run on the whole batch."""
        for step in self._whole:
            step.begin()

    def finish(self) -> None:
        """Copy the sources of which a caller has an array, if the layers run on the whole batch."""
        for step in self._whole:
            step.finish()

    def keep(self, source: Blob) -> None:
        """Copy a source, likewise."""
        for step in self._whole:
            if source in step.sources:
                step.keep(source)

    def _written(self, blob: Blob) -> NetlibError:
        """The error for an input that a caller has written between forward and backward."""
        at = self._user[blob]
        name = at.layer.spec.bottom[at.bottom.index(blob)]
        first = self.connections[0].layer.spec.top[0]
        return NetlibError(
            f"blob {name!r} was written between forward and backward, which would give the gradient of no pass: run "
            f"forward again, or read a blob such as {first!r} before, so that the net stores all blobs"
        )
