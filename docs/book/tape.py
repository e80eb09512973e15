"""A tape: operations on values note how they pass gradients back; ``backward`` reads the
notes from the end.
"""

from __future__ import annotations

import numpy as np


class Value:
    """An array, its gradient, and the tape that its operations write to: a list
    that values share.
    """

    def __init__(self, data, tape):
        self.data = np.array(data, dtype=float)
        self.diff = np.zeros_like(self.data)
        self.tape = tape

    def note(self, data, *inputs):
        """The result of an operation.

        Each of its inputs comes with a function from dy to its gradient.
        """
        y = Value(data, self.tape)
        self.tape.append((y, inputs))
        return y

    def __add__(self, other):
        return self.note(self.data + other.data, (self, lambda dy: dy), (other, lambda dy: dy))

    def __sub__(self, other):
        return self.note(self.data - other.data, (self, lambda dy: dy), (other, lambda dy: -dy))

    def __mul__(self, other):
        return self.note(
            self.data * other.data,
            (self, lambda dy: dy * other.data),
            (other, lambda dy: dy * self.data),
        )

    def __matmul__(self, other):
        return self.note(
            self.data @ other.data,
            (self, lambda dy: dy @ other.data.T),
            (other, lambda dy: self.data.T @ dy),
        )

    def relu(self):
        return self.note(np.maximum(self.data, 0), (self, lambda dy: dy * (self.data > 0)))

    def sum(self):
        return self.note(self.data.sum(), (self, lambda dy: dy * np.ones(self.data.shape)))

    def backward(self):
        """Add dL/dv to the diff of every value v on the tape, for L = this value."""
        self.diff += 1
        for y, inputs in reversed(self.tape):
            for v, gradient in inputs:
                v.diff += gradient(y.diff)
