"""MultinomialLogisticLoss: cross-entropy of given probabilities against labels.

For probabilities from a softmax, SoftmaxWithLoss is more accurate.

bottom[0]  p       (N, ...)  probabilities; all axes after the first are K classes
bottom[1]  labels  (N,)      integers from 0 to K - 1
top[0]     L       scalar

L  = - 1 / N sum of log max(p[label], 1e-20)
dp = - dL / N / max(p[label], 1e-20) at the label, 0 elsewhere
"""

from __future__ import annotations

import numpy as np

from layers.loss import labels as labels_of
from layers.loss.labels import LabelLoss
from netlib.blob import Array, Blobs


class MultinomialLogisticLoss(LabelLoss):
    """Negative log-likelihood of the labels."""

    def reshape(self, bottom: Blobs, top: Blobs) -> None:
        self.shape = labels_of.rows(self, bottom)
        top[0].reshape(())

    def _chosen(self, bottom: Blobs) -> tuple[tuple[Array, Array], Array]:
        """Index of the labels' probabilities, and their values."""
        N, K = self.shape
        labels, _ = labels_of.read(self, bottom, K)
        at = np.arange(N), labels
        p = bottom[0].data.reshape(N, K)
        return at, np.maximum(p[at], labels_of.MIN_PROBABILITY)

    def forward(self, bottom: Blobs, top: Blobs) -> None:
        _, p = self._chosen(bottom)
        top[0].data[...] = (0 - np.log(p).sum()) / len(p)

    def backward(self, top: Blobs, propagate_down: list[bool], bottom: Blobs) -> None:
        if propagate_down[1]:
            raise self.fail("has no gradient for its labels; set propagate_down: false for them")
        if propagate_down[0]:
            at, p = self._chosen(bottom)
            dp = np.zeros(self.shape, self.dtype)
            dp[at] = -top[0].diff / (len(p) * p)
            bottom[0].diff[...] = dp.reshape(bottom[0].shape)
