"""The test of a net: the means of its outputs over several batches."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np

from netlib.blob import Array
from netlib.errors import LayerError
from netlib.net import Net

log = logging.getLogger("netlib")


def means_of(
    net: Net, what: str, batches: int, is_stopped: Callable[[], bool]
) -> tuple[float, dict[str, Array]] | None:
    """Run batches of a net; returns the mean loss, and the mean of each output, flat. None if it was stopped.

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
