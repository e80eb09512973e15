"""Wrong answers of a reader, written from scratch, and the words with which the advice names the fault."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from exercises.checking import steps
from exercises.runner import LocalRunner
from exercises.table import EXERCISES
from layers.activation.relu import ReLU
from layers.common.inner_product import InnerProduct
from layers.hand.kinematics import Kinematics
from layers.hand.phys_limit import PhysLimit
from layers.vision.convolution import Convolution
from layers.vision.pooling import Pooling


def said(name: str, part: Any) -> str:
    """Return the lines of the step that fails."""
    *_, step = steps(EXERCISES[name], LocalRunner(EXERCISES[name], part))
    assert not step.passed
    return "\n".join(step.lines)


# ---------------------------------------------------------------------------------------------- relu


class Rebinds(ReLU):
    def forward(self, bottom: Any, top: Any) -> None:
        y = np.where(bottom[0].data > 0, bottom[0].data, self.slope * bottom[0].data)
        y = y + 0


class GateTimesOutput(ReLU):
    def backward(self, top: Any, propagate_down: Any, bottom: Any) -> None:
        x = bottom[0].data
        g = np.where(x > 0, 1.0, self.slope)
        bottom[0].diff[...] = g * (g * x)


# ---------------------------------------------------------------------------------------------- sgd

Rule = Callable[..., Any]


def other_sign(p: Any, w: Any, g: Any, rate: float, history: Any, t: int) -> None:
    v = history[0]
    v *= p.momentum
    v -= rate * g
    w += v


def rate_twice(p: Any, w: Any, g: Any, rate: float, history: Any, t: int) -> None:
    history[0][:] = history[0] * p.momentum + g * rate
    w[:] = w - history[0] * rate


def rebinds_entry(p: Any, w: Any, g: Any, rate: float, history: Any, t: int) -> None:
    history[0] = p.momentum * history[0] + rate * g
    w -= history[0]


def heavy_ball(p: Any, w: Any, g: Any, rate: float, history: Any, t: int) -> None:
    before = w.copy()
    if t > 1:
        w += p.momentum * (w - history[0])
    w -= rate * g
    history[0][...] = before


def returns_weights(p: Any, w: Any, g: Any, rate: float, history: Any, t: int) -> Any:
    history[0][...] = p.momentum * history[0] + rate * g
    return w - history[0]


def bias_corrected(p: Any, w: Any, g: Any, rate: float, history: Any, t: int) -> None:
    history[0][...] = p.momentum * history[0] + rate * g
    w -= history[0] / (1 - p.momentum**t)


# ---------------------------------------------------------------------------------------------- phys_limit


class Limits(PhysLimit):
    """A reader's layer, which handles the angles one by one."""

    def violation(self, x: float, lower: float, upper: float) -> float:
        return max(x - upper, 0.0) + max(lower - x, 0.0)

    def loss(self, v: np.ndarray) -> float:
        return float((v if self.param.norm == "L1" else v**2).sum() / len(v))

    def slope(self, x: float, lower: float, upper: float) -> float:
        sign = (x > upper) * 1.0 - (x < lower)
        return sign if self.param.norm == "L1" else sign * 2 * self.violation(x, lower, upper)

    def forward(self, bottom: Any, top: Any) -> None:
        self.x = bottom[0].data.reshape(-1, len(self.lower)).copy()
        v = np.array([[self.violation(*one) for one in zip(row, self.lower, self.upper)] for row in self.x])
        top[0].data[...] = self.loss(v)

    def backward(self, top: Any, propagate_down: Any, bottom: Any) -> None:
        s = np.array([[self.slope(*one) for one in zip(row, self.lower, self.upper)] for row in self.x])
        self.write(bottom[0].diff.reshape(s.shape), s * top[0].diff / len(s))

    def write(self, dx: np.ndarray, found: np.ndarray) -> None:
        dx[...] = found


class AtLimit(Limits):
    def slope(self, x: float, lower: float, upper: float) -> float:
        sign = (x >= upper) * 1.0 - (x <= lower)
        return sign if self.param.norm == "L1" else sign * 2 * self.violation(x, lower, upper)


class WritesBeyond(Limits):
    def write(self, dx: np.ndarray, found: np.ndarray) -> None:
        dx[found != 0] = found[found != 0]


class SlopeV(Limits):
    def slope(self, x: float, lower: float, upper: float) -> float:
        v = max(x - upper, 0.0) - max(lower - x, 0.0)
        return v if self.param.norm == "L1" else 2 * v


class MeanOverViolations(Limits):
    def loss(self, v: np.ndarray) -> float:
        return float((v if self.param.norm == "L1" else v**2).sum() / max(1, (v > 0).sum()))


class SumSquared(Limits):
    def loss(self, v: np.ndarray) -> float:
        return float((v.sum() if self.param.norm == "L1" else v.sum() ** 2) / len(v))


class InDegrees(Limits):
    def violation(self, x: float, lower: float, upper: float) -> float:
        return float(np.degrees(max(x - upper, 0.0) + max(lower - x, 0.0)))


# ---------------------------------------------------------------------------------------------- torque_gradient


class Torques(Kinematics):
    """A reader's walk over the joints, written independently."""

    order = "order"
    hands_on = "both"
    place = axis = "own"
    adds_within = False

    def backward(self, pose: Any, dX: Any) -> Any:
        sk, X = self.skeleton, pose.joints
        f, tau = dX.copy(), dX * 0
        out = np.zeros((len(dX), len(sk.initial)))
        count = range(len(sk.parents))
        walk = {"order": list(sk.order)[::-1], "file": list(count), "reversed file": list(count)[::-1]}[self.order]
        for j in walk:
            parent = sk.parents[j]
            for m in sk.motions[j]:
                if m.row < 0:
                    continue
                a, P = pose.axis[:, m.row], pose.pivot[:, m.row]
                if self.place == "parent":
                    P = X[:, parent] if parent >= 0 else 0 * P
                if self.axis == "finished":
                    a = m.sign * pose.frames[:, j, :, m.axis]
                here = tau[:, j] + np.cross(X[:, j] - P, f[:, j])
                if self.adds_within:
                    tau[:, j] = here
                out[:, m.dof] += ((f[:, j] if m.kind == "translate" else here) * a).sum(1)
            if parent >= 0:
                f[:, parent] += f[:, j]
                lever = np.cross(X[:, j] - X[:, parent], f[:, j])
                tau[:, parent] += tau[:, j] + (lever if self.hands_on == "both" else 0)
        return out.astype(self.dtype)


def torques(**changed: Any) -> type[Torques]:
    """Return the walk with a change."""
    return type("Changed", (Torques,), changed)


# ---------------------------------------------------------------------------------------------- convolution


class Loops(Convolution):
    """A reader's convolution by loops over the windows."""

    edge, transposed, twice, no_stride, interleaved, last_bias, clears = False, False, False, False, False, False, True

    def windows(self, y: Any) -> Any:
        w, p = self.weight.data, self.param
        per_out, per_in = p.num_output // p.group, self.channels // p.group
        for o, h, v in np.ndindex(y.shape[1:]):
            for c, i, j in np.ndindex(w.shape[1:]):
                g = o // per_out
                channel = g + c * p.group if self.interleaved else g * per_in + c
                yield (o, h, v), (c, i, j), channel, (i * self.dilation[0], j * self.dilation[1])

    def forward(self, bottom: Any, top: Any) -> None:
        x, y = bottom[0].data, top[0].data
        pads = [(0, 0), (0, 0), *((p, p) for p in self.pad)]
        padded = np.pad(x, pads, mode="edge") if self.edge else np.pad(x, pads)
        y[...] = self.bias.data.reshape(-1, 1, 1) if self.param.bias_term else 0
        for (o, h, v), (c, i, j), channel, (di, dj) in self.windows(y):
            row, column = h * self.stride[0] + di, v * self.stride[1] + dj
            if self.twice:
                row, column = row - self.pad[0], column - self.pad[1]
                if row < 0 or column < 0:
                    continue
            square = self.transposed and self.kernel[0] == self.kernel[1]
            k = self.weight.data[(o, c, j, i) if square else (o, c, i, j)]
            y[:, o, h, v] += k * padded[:, channel, row, column]

    def backward(self, top: Any, propagate_down: Any, bottom: Any) -> None:
        x, dy = bottom[0].data, top[0].diff
        padded = np.pad(x, [(0, 0), (0, 0), *((p, p) for p in self.pad)])
        dx = np.zeros_like(padded)
        for (o, h, v), (c, i, j), channel, (di, dj) in self.windows(dy):
            row, column = h * self.stride[0] + di, v * self.stride[1] + dj
            self.weight.diff[o, c, i, j] += (dy[:, o, h, v] * padded[:, channel, row, column]).sum()
            if self.no_stride:
                row, column = h + di, v + dj
            dx[:, channel, row, column] += dy[:, o, h, v] * self.weight.data[o, c, i, j]
        if self.param.bias_term:
            self.bias.diff[...] += dy[-1].sum((1, 2)) if self.last_bias else dy.sum((0, 2, 3))
        if propagate_down[0]:
            (p, q), (H, W) = self.pad, x.shape[2:]
            inside = dx[:, :, p : p + H, q : q + W]
            bottom[0].diff[...] = inside if self.clears else bottom[0].diff + inside


def loops(**changed: bool) -> type[Loops]:
    """Return the convolution with a change."""
    return type("Changed", (Loops,), changed)


class WindowByWindow(Convolution):
    """A reader's backward with one loop for each index; ``assigned`` has the arrays that are not added to."""

    assigned: tuple[str, ...] = ()
    keeps_padding = False

    def put(self, name: str, array: Any, index: Any, value: Any) -> None:
        array[index] = value if name in self.assigned else array[index] + value

    def backward(self, top: Any, propagate_down: Any, bottom: Any) -> None:
        x, dy, w, p = bottom[0].data, top[0].diff, self.weight.data, self.param
        (q, r), (H, W), (kh, kw), (dh, dv) = self.pad, x.shape[2:], self.kernel, self.dilation
        padded = np.pad(x, [(0, 0), (0, 0), (q, q), (r, r)])
        dx, per_in = np.zeros_like(padded), self.channels // p.group
        for n, o, h, v in np.ndindex(dy.shape):
            first = o // (p.num_output // p.group) * per_in
            row, column, d = h * self.stride[0], v * self.stride[1], dy[n, o, h, v]
            window = (n, slice(first, first + per_in), slice(row, row + dh * (kh - 1) + 1, dh),
                      slice(column, column + dv * (kw - 1) + 1, dv))
            self.put("dw", self.weight.diff, o, d * padded[window])
            self.put("dx", dx, window, d * w[o])
            if p.bias_term:
                self.put("db", self.bias.diff, o, d)
        bottom[0].diff[...] = dx[:, :, :H, :W] if self.keeps_padding else dx[:, :, q : q + H, r : r + W]


class ImageByImage(Convolution):
    """A reader's backward with matrix products for each image; ``assigned`` has what is not added to."""

    assigned: tuple[str, ...] = ()
    windows_inside = False

    def columns(self, image: Any, shape: Any) -> Any:
        if not self.windows_inside:
            return self.im2col(image, shape)
        padded = np.pad(image, [(0, 0), *((0, 2 * p) for p in self.pad)])
        return np.stack([padded[part] for part in self.window_slices(shape)], axis=1).reshape(-1, np.prod(shape[1:]))

    def backward(self, top: Any, propagate_down: Any, bottom: Any) -> None:
        w, dw = self.by_group(self.weight.data), self.by_group(self.weight.diff)
        for n, (image, gradient) in enumerate(zip(bottom[0].data, top[0].diff)):
            dy = self.by_group(gradient)
            found = dy @ self.by_group(self.columns(image, gradient.shape)).swapaxes(1, 2)
            dw[...] = found if "dw" in self.assigned else dw + found
            if self.param.bias_term:
                db = gradient.sum(axis=(1, 2))
                self.bias.diff[...] = db if "db" in self.assigned else self.bias.diff + db
            bottom[0].diff[n] = self.col2im(w.swapaxes(1, 2) @ dy, image.shape, gradient.shape)


# ---------------------------------------------------------------------------------------------- pooling, inner_product


class NoTranspose(Convolution):
    """A reader's forward with the weights transposed where they must not be."""

    def forward(self, bottom: Any, top: Any) -> None:
        w = self.by_group(self.weight.data).swapaxes(1, 2)
        for image, out in zip(bottom[0].data, top[0].data):
            out[...] = (w @ self.by_group(self.im2col(image, out.shape))).reshape(out.shape)


class PoolingByWindow(Pooling):
    """A reader's backward with loops over the windows."""

    assigned = keeps_padding = False

    def backward(self, top: Any, propagate_down: Any, bottom: Any) -> None:
        dy, dx = top[0].diff, bottom[0].diff
        (sh, sw), (p, q), (kh, kw), (H, W) = self.stride, self.pad, self.kernel, dx.shape[2:]
        for n, x in enumerate(bottom[0].data):
            padded = self.padded(np.zeros_like(x), dy.shape, 0)
            area = self.area(dx.shape, dy.shape)
            for c, h, w in np.ndindex(dy.shape[1:]):
                part = padded[c, h * sh : h * sh + kh, w * sw : w * sw + kw]
                if self.is_max:
                    part[divmod(self.winners[n, c, h, w], kw)] += dy[n, c, h, w]
                else:
                    part[...] = dy[n, c, h, w] / area[h, w] + (0 if self.assigned else part)
            dx[n] = padded[:, :H, :W] if self.keeps_padding else padded[:, p : p + H, q : q + W]


class ItemByItem(InnerProduct):
    """A reader's backward with a loop over the items; ``assigned`` has what is not added to."""

    assigned: tuple[str, ...] = ()

    def backward(self, top: Any, propagate_down: Any, bottom: Any) -> None:
        dw, w = self.output_first(self.weight.diff), self.output_first(self.weight.data)
        for x, dx, dy in zip(self.rows(bottom[0].data), self.rows(bottom[0].diff), self.rows(top[0].diff)):
            dw[...] = np.outer(dy, x) + (0 if "dw" in self.assigned else dw)
            if self.param.bias_term:
                self.bias.diff[...] = dy + (0 if "db" in self.assigned else self.bias.diff)
            dx[...] = dy @ w


def changed(part: type, **changes: Any) -> Any:
    """Return the part with other attributes."""
    return type("Changed", (part,), changes)


ANSWERS = [
    ("convolution", changed(ImageByImage, assigned=("dw",)), "dw[...] = inside the loop over the images"),
    ("convolution", changed(ImageByImage, assigned=("db",)), "db[...] = inside the loop over the images"),
    ("convolution", changed(ImageByImage, assigned=("dw", "db")), "Use dw[...] += there"),
    ("convolution", changed(ImageByImage, windows_inside=True), "dw uses windows without the padding"),
    ("convolution", changed(WindowByWindow, assigned=("dw",)), "dw is assigned inside the loop over the windows"),
    ("convolution", changed(WindowByWindow, assigned=("db",)), "db is assigned inside the loop over the windows"),
    ("convolution", changed(WindowByWindow, assigned=("dx",)), "The loop over output maps and windows assigns to dx"),
    ("convolution", changed(WindowByWindow, keeps_padding=True), "Cut the padding off"),
    ("convolution", NoTranspose, "a factor may need a transpose"),
    ("pooling", changed(PoolingByWindow, assigned=True), "The loop over the windows of AVE assigns to dx"),
    ("pooling", changed(PoolingByWindow, keeps_padding=True), "Cut the padding off"),
    ("inner_product", changed(ItemByItem, assigned=("dw",)), "dw[...] = inside the loop over the items"),
    ("inner_product", changed(ItemByItem, assigned=("db",)), "db[...] = inside the loop over the items"),
    ("relu", Rebinds, "nothing was written"),
    ("relu", GateTimesOutput, "slope is multiplied by y"),
    ("sgd", other_sign, "h has the opposite sign, although w is correct"),
    ("sgd", rate_twice, "The rate is applied twice"),
    ("sgd", rebinds_entry, "The new h is lost"),
    ("sgd", heavy_ball, "h holds the old weights"),
    ("sgd", returns_weights, "The new w is lost"),
    ("sgd", bias_corrected, "Adam's bias correction"),
    ("phys_limit", AtLimit, "Exactly at a limit the slope is 0"),
    ("phys_limit", WritesBeyond, "leaves some elements of the diff"),
    ("phys_limit", SlopeV, "the derivative of v is ±1 for any v"),
    ("phys_limit", MeanOverViolations, "the number of angles out of limits"),
    ("phys_limit", SumSquared, "With norm L2 each v is squared before summing"),
    ("phys_limit", InDegrees, "v is in degrees"),
    ("torque_gradient", torques(order="file"), "in file order"),
    ("torque_gradient", torques(order="reversed file"), "in reverse file order"),
    ("torque_gradient", torques(place="parent"), "the torque about the parent."),
    ("torque_gradient", torques(axis="finished"), "the joint's final frame"),
    ("torque_gradient", torques(hands_on="torque"), "add (X_c - X_j) x force_c"),
    ("torque_gradient", torques(adds_within=True), "once for every motion of the joint"),
    ("convolution", loops(transposed=True), "Rows and columns of the kernel are exchanged"),
    ("convolution", loops(edge=True), "The padding is 0"),
    ("convolution", loops(twice=True), "The padding is counted twice"),
    ("convolution", loops(no_stride=True), "dx ignores the stride"),
    ("convolution", loops(interleaved=True), "The groups are interleaved"),
    ("convolution", loops(last_bias=True), "db contains only the last image"),
    ("convolution", loops(clears=False), "backward adds to the diff of a bottom"),
]
RIGHT = [("phys_limit", Limits), ("torque_gradient", Torques), ("convolution", Loops), ("convolution", WindowByWindow),
         ("convolution", ImageByImage), ("pooling", PoolingByWindow), ("inner_product", ItemByItem)]


@pytest.mark.parametrize(("name", "part", "words"), ANSWERS, ids=[f"{n}-{w}" for n, _, w in ANSWERS])
def test_the_advice_names_the_fault(name: str, part: Any, words: str) -> None:
    """The advice names the fault in each of these answers."""
    assert words in said(name, part)


@pytest.mark.parametrize(("name", "part"), RIGHT)
def test_right_answers_written_so_are_accepted(name: str, part: Any) -> None:
    """The correct versions of the wrong answers pass."""
    assert all(step.passed for step in steps(EXERCISES[name], LocalRunner(EXERCISES[name], part)))
