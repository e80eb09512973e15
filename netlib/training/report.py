"""Lines of Caffe's training log: outputs of nets and their means in a test, debug_info, warnings of
trainings that change nothing; and the format of the lines (glog), which log parsers read.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, SupportsFloat

import numpy as np

from netlib.blob import Array
from netlib.errors import LayerError, printable
from netlib.net import Net
from netlib.proto.prototxt import Message

log = logging.getLogger("netlib")


def copied(source: object, ignored: Iterable[str], missing: Iterable[str]) -> None:
    """Log the layers that ``Net.copy_from`` skipped: those of the source, then those of the net."""
    for name in ignored:
        log.info("Ignoring source layer %s", name)
    for name in missing:
        log.info("Not in %s, keeps its initial values: layer %s", source, name)


def outputs(what: str, net: Net, values_of: Mapping[str, Array]) -> None:
    """Log ``    Train net output #0: loss = 0.86 (* 1 = 0.86 loss)`` for each value
    of each output.
    """
    for number, score in enumerate(scores(net, values_of)):
        log.info("    %s net output #%d: %s", what, number, score)


def scores(net: Net, values_of: Mapping[str, Array]) -> Iterator[str]:
    """Yield ``loss = 0.86 (* 1 = 0.86 loss)`` for each value of each output."""
    weights = {name: weight for _, weight, name in net.losses}
    for name, values in values_of.items():
        weight = weights.get(name)
        for value in values.reshape(-1):
            tail = f" (* {weight:.6g} = {weight * value:.6g} loss)" if weight else ""
            yield f"{name} = {value:.6g}{tail}"


def means_of(
    net: Net, what: str, batches: int, is_stopped: Callable[[], bool]
) -> tuple[float, dict[str, Array]] | None:
    """Run batches of a net; returns the mean loss, and the mean of each output, flat.

    None if it was stopped.

    ``what`` names the net in messages. Raises LayerError for an output whose size changes.
    """
    sums: dict[str, Array] = {}
    loss = 0.0
    for _ in range(batches):
        loss += net.run_forward()
        for name in net.outputs:
            values = net.blobs[name].data.astype(np.float64).reshape(-1)
            if values.size != np.size(sums.setdefault(name, np.zeros_like(values))):
                raise LayerError(
                    f"{what}: output {name!r} has {values.size} values in this batch, had {np.size(sums[name])}, so no "
                    "mean exists; expected equal numbers in all batches, or a Silence layer that reads it"
                )
            sums[name] += values
        if is_stopped():
            return None
    if not np.isfinite(loss):
        where = net.first_not_finite() or "its loss alone"
        log.error("%s has a value that is not finite: %s", what.capitalize(), where)
    return loss / max(batches, 1), {name: total / batches for name, total in sums.items()}


# --------------------------------------------------------------------------------------- debug_info


def debug_forward(net: Net) -> float:
    """Run the layers one by one and log the mean absolute values of their tops and parameters, as
    Caffe's debug_info does. Returns the loss.
    """
    for number, at in enumerate(net.connections):
        net.run_forward(number, number + 1)
        line = "    [Forward] Layer %s, %s blob %s data: %.6g"
        for name, blob in zip(at.layer.spec.top, at.top):
            log.info(line, at.layer.name, "top", name, _mean(blob.data))
        names = {i: param.name for i, param in enumerate(at.layer.spec.param)}
        for i, blob in enumerate(at.layer.blobs):
            log.info(line, at.layer.name, "param", names.get(i) or i, _mean(blob.data))
    return net.loss()


def debug_backward(net: Net) -> None:
    """Run the layers backwards one by one and log the mean absolute values of the gradients,
    but not of parameters with lr_mult 0: Caffe does not compute these.
    """
    for number, at in reversed(list(enumerate(net.connections))):
        net.run_backward(number, number + 1)
        if not at.needs_backward:
            continue
        line = "    [Backward] Layer %s, %s blob %s diff: %.6g"
        for name, blob, down in zip(at.layer.spec.bottom, at.bottom, at.propagate_down):
            if down:
                log.info(line, at.layer.name, "bottom", name, _mean(blob.diff))
        frozen = [i for i, param in enumerate(at.layer.spec.param) if param.lr_mult == 0]
        for i, blob in enumerate(at.layer.blobs):
            if i not in frozen:
                log.info(line, at.layer.name, "param", i, _mean(blob.diff))


def debug_params(net: Net) -> None:
    """Log the norms and mean absolute values of all parameters and gradients before an update.

    As in Caffe, the gradients of parameters with lr_mult 0 are not in the norms.
    """
    data = [p.blob.data.astype(np.float64) for p in net.learnable]
    diffs = [p.blob.diff.astype(np.float64) for p in net.learnable if p.spec.lr_mult]
    log.info(
        "    [Backward] All net params (data, diff): L1 norm = (%.6g, %.6g); L2 norm = (%.6g, %.6g)",
        *(sum(np.abs(array).sum() for array in arrays) for arrays in (data, diffs)),
        *(np.sqrt(sum(np.square(array).sum() for array in arrays)) for arrays in (data, diffs)),
    )
    for p in net.learnable:
        log.info(
            "    [Update] Layer %s, param %d data: %.6g; diff: %.6g",
            p.layer,
            p.index,
            _mean(p.blob.data),
            _mean(p.blob.diff),
        )


def _mean(array: Any) -> float:
    return float(np.abs(array).mean()) if array.size else 0.0


# -------------------------------------------------------------------- trainings that change nothing


Functions = list[Callable[[], object]]


def lack_of_loss(net: Net) -> Iterator[str]:
    """Yield a warning for each output that looks like a loss but has no loss_weight, or for a net
    without any loss.
    """
    outputs = [
        (at.layer, name, blob)
        for at in net.connections
        for name, blob in zip(at.layer.spec.top, at.top)
        if name in net.outputs and not at.layer.spec.loss_weight
    ]
    named = [
        (layer, name)
        for layer, name, _ in outputs
        if "loss" in f"{name} {layer.name} {type(layer).__name__}".lower()
    ]
    if net.losses:
        for layer, name in named:
            # as in Caffe, its weight is 0 if none is given; another type may be a metric
            if layer.type == "Python":
                yield f"top {name!r} of layer {layer.name!r} looks like a loss, but has no loss_weight; it is ignored"
        return
    found = named or [
        (layer, name)
        for layer, name, blob in outputs
        if blob.count == 1 and layer.type != "Accuracy"
    ]
    if found:
        layer, name = found[-1]
        advice = (
            f"top {name!r} of layer {layer.name!r} looks like one: add loss_weight: 1 to the layer"
        )
    else:
        advice = f"its outputs: {', '.join(net.outputs) or 'none'}"
    yield f"net {net.name!r} has no loss: no output has a loss_weight, so no weight changes; {advice}"


def warn_of_no_progress(
    net: Net, on_step: Functions, on_gradients_ready: Functions, iterations: int = 3
) -> None:
    """Add functions to these lists of a solver that warn once of a training which changes no
    weight: its net has no loss, or the gradients of its first iterations are all 0. Those of one
    batch can be, as of a hinge loss without violations.
    """
    left = iterations

    def warn_of_no_loss() -> None:
        nonlocal left
        for message in lack_of_loss(net):
            log.warning("%s", message)
        if not net.losses:
            left = 0
        on_step.remove(warn_of_no_loss)

    def warn_of_zeros() -> None:
        nonlocal left
        learned = [param for param in net.learnable if param.spec.lr_mult]
        if not left or not learned or any(param.blob.diff.any() for param in learned):
            on_gradients_ready.remove(warn_of_zeros)
            return
        left -= 1
        if not left:
            log.warning(
                "the gradients of all parameters were exactly 0 in the first %d iterations, so no weight "
                "changes: check that a loss depends on them (propagate_down, layers of constant output such "
                "as a ReLU of negative values)",
                iterations,
            )

    on_step.append(warn_of_no_loss)
    on_gradients_ready.append(warn_of_zeros)


# ------------------------------------------------------------------------------------------- format


def show_printable(record: logging.LogRecord) -> bool:
    """Logging filter that escapes arguments, so that no name can start a new line.

    Numbers are not changed. A Message (a prototxt) may have several lines; its names are
    quoted already.
    """
    if isinstance(record.args, tuple) and record.args:
        record.args = tuple(
            arg if isinstance(arg, (SupportsFloat, Message)) else printable(arg)
            for arg in record.args
        )
    else:
        record.msg = printable(record.msg)
    return True


log.addFilter(show_printable)


class CaffeFormatter(logging.Formatter):
    """Formats lines as glog does: ``I1121 01:57:02.956642 28053
    solver.py:238] Iteration 3 ...``.
    """

    def format(self, record: logging.LogRecord) -> str:
        """Return the line for one record."""
        stamp = time.strftime("%m%d %H:%M:%S", time.localtime(record.created))
        micro = int(record.created % 1 * 1e6)
        # like glog, which adds a line break only if one is missing
        text = record.getMessage().rstrip("\n")
        letter = record.levelname[0]
        return f"{letter}{stamp}.{micro:06d} {record.process} {record.filename}:{record.lineno}] {text}"
