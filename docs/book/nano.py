"""Model-based Deep Hand Pose Estimation (Zhou, Wan, Zhang, Xue, Wei; IJCAI 2016): the whole paper,
on NumPy alone.

python docs/book/nano.py            train on 32 rendered frames, print losses and errors, draw a
                                    hand before and after
python docs/book/nano.py --check    compare the losses of 20 updates with netlib's:
                                    float64, no dropout

A layer is a function that reads x and writes y. It returns y and a second function, ``backward``,
which turns dy into dx and a list of the gradients of the layer's parameters. dv is dL/dv, the
gradient of the loss L with respect to v.
"""

import re
import sys
from pathlib import Path

import numpy as np

HAND = Path(__file__).resolve().parents[2] / "prototxt" / "hand" / "nyu.prototxt"
# 64 rendered crops of 128 x 128 pixels, and their joints
FRAMES = Path(__file__).with_name("frames.npz")

# ---------------------------------------------------------------- the layers: chapters 1 to 4 and 7


def relu(x):
    return np.maximum(x, 0), lambda dy: (dy * (x > 0), [])


def inner_product(x, w, b):
    """y[n, o] = b[o] + the sum over i of w[o, i] x[n, i]"""
    items = x.reshape(len(x), -1)

    def backward(dy):
        dx = (dy @ w).reshape(x.shape)
        return dx, [dy.T @ items, dy.sum(axis=0)]

    return items @ w.T + b, backward


def convolution(x, w, b):
    """y[n, o, h, w] = b[o] + the sum over c, i, j of w[o, c, i, j] x[n, c, h + i, w + j]"""
    (N, _, H, W), (O, _, *kernel) = x.shape, w.shape
    rows, columns = H - kernel[0] + 1, W - kernel[1] + 1

    def seen_by(i, j):  # the pixels that this element of the kernel is multiplied by
        return np.s_[:, :, i : i + rows, j : j + columns]

    y = np.zeros((N, O, rows, columns)) + b[:, None, None]
    for i, j in np.ndindex(*kernel):
        y += np.einsum("oc,nchw->nohw", w[:, :, i, j], x[seen_by(i, j)])

    def backward(dy):
        dx, dw = np.zeros_like(x), np.zeros_like(w)
        for i, j in np.ndindex(*kernel):
            pixels = seen_by(i, j)
            dw[:, :, i, j] = np.einsum("nohw,nchw->oc", dy, x[pixels])
            dx[pixels] += np.einsum("oc,nohw->nchw", w[:, :, i, j], dy)
        return dx, [dw, dy.sum(axis=(0, 2, 3))]

    return y, backward


def max_pool(x, k):
    """The maximum of each window of k x k; a last window may reach beyond the edge of the map."""
    H, W = x.shape[2:]
    elements = [np.s_[:, :, i::k, j::k] for i, j in np.ndindex(k, k)]
    beyond = [(0, 0), (0, 0), (0, -H % k), (0, -W % k)]
    padded = np.pad(x, beyond, constant_values=-np.inf)
    values = np.stack([padded[element] for element in elements])  # (k k, N, C, rows, columns)
    winner = values.argmax(axis=0)  # the first of equal values

    def backward(dy):
        dx = np.zeros_like(padded)
        for number, element in enumerate(elements):
            dx[element] = dy * (winner == number)
        return dx[:, :, :H, :W], []

    return values.max(axis=0), backward


def dropout(x, p, rng):
    """Zero each value with probability p and scale up the others, so that the mean is unchanged."""
    mask = (rng.random(x.shape) >= p) / (1 - p)
    return x * mask, lambda dy: (dy * mask, [])


# ----------------------------------------------------------------------- the hand: chapters 8 and 9


class Skeleton:
    """A hand's file as arrays: the degrees of freedom (DoFs), and the parent, motions and bone
    of each joint.
    """

    def __init__(self, path):
        text = re.sub(r'#.*|"', "", path.read_text(encoding="utf-8"))
        blocks = re.findall(r"^dof {(.*)}", text, re.M)
        dofs = [dict(re.findall(r"(\w+): (\S+)", block)) for block in blocks]
        self.initial = np.array([float(dof["initial"]) for dof in dofs])
        self.lower = np.array([float(dof.get("lower", "-inf")) for dof in dofs])
        self.upper = np.array([float(dof.get("upper", "inf")) for dof in dofs])
        self.free = np.array(["fixed" not in dof for dof in dofs])
        dof_names = [dof["name"] for dof in dofs]
        joints = re.findall(r"^joint {(.*?)^}", text, re.M | re.S)
        names = [re.search(r"name: (\w+)", joint)[1] for joint in joints]
        self.parent, self.motions, self.bone = [], [], []
        for joint in joints:
            parent = re.search(r"parent: (\w+)", joint)
            self.parent.append(names.index(parent[1]) if parent else -1)  # -1 is the world
            motions = re.findall(r"(translate|rotate) {.*axis: (\w+) dof: (\w+)", joint)
            own = [(kind, unit(axis), dof_names.index(dof)) for kind, axis, dof in motions]
            self.motions.append(own)
            bone = re.search(r"bone {.*axis: (\w+) length: (\S+)", joint)
            self.bone.append(unit(bone[1]) * float(bone[2]) if bone else np.zeros(3))
        self.order = sorted(range(len(joints)), key=self.depth)  # from the root outwards

    def depth(self, j):
        return 0 if j < 0 else 1 + self.depth(self.parent[j])


def unit(axis):
    return np.eye(3)["XYZ".index(axis[-1])] * (-1 if "NEG" in axis else 1)


def rotation(axis, angle):
    """Rotations (N, 3, 3) about a unit vector, by Rodrigues' formula."""
    K, angle = np.cross(np.eye(3), axis), angle[:, None, None]  # K v is the cross product axis x v
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def hand_model(x, hand):
    """Forward kinematics: from the DoFs x (N, 47) to the positions of the joints (N, 31, 3);
    backward by torques.
    """
    theta, N, K = np.where(hand.free, x, 0) + hand.initial, len(x), len(hand.parent)
    X = np.zeros((N, K + 1, 3))  # the last is the world
    frames = np.zeros((N, K + 1, 3, 3)) + np.eye(3)
    axes = {}
    for j in hand.order:
        p, F = X[:, hand.parent[j]], frames[:, hand.parent[j]]
        for m, (kind, axis, d) in enumerate(hand.motions[j]):
            axes[j, m] = a, _ = F @ axis, p
            if kind == "translate":
                p = p + a * theta[:, d, None]
            else:
                F = F @ rotation(axis, theta[:, d])
        X[:, j], frames[:, j] = p + F @ hand.bone[j], F

    def backward(dX):
        dx, force, torque = np.zeros_like(x), np.zeros_like(X), np.zeros_like(X)
        force[:, :K] = dX
        for j in reversed(hand.order):  # from the tips inwards
            for m, (kind, _, d) in enumerate(hand.motions[j]):
                a, p = axes[j, m]
                torque_about_p = torque[:, j] + np.cross(X[:, j] - p, force[:, j])
                moved = force[:, j] if kind == "translate" else torque_about_p
                dx[:, d] += (a * moved).sum(axis=1)
            parent = hand.parent[j]
            force[:, parent] += force[:, j]
            lever = X[:, j] - X[:, parent]
            torque[:, parent] += torque[:, j] + np.cross(lever, force[:, j])
        return dx * hand.free

    return X[:, :K], backward


# -------------------------------------------------- the network and its training: chapters 5, 6, 10


def new_network(rng, p):
    """Each layer with its arguments: parameters (w, b), a size, or a probability."""

    def parameters(*shape, std=None):
        std = std or np.prod(shape[1:]) ** -0.5
        return rng.normal(0, std, shape), np.zeros(shape[0])

    return [
        (convolution, *parameters(8, 1, 5, 5)),  # of 128 x 128 pixels
        (relu,),
        (max_pool, 4),  # 8 x 31 x 31
        (convolution, *parameters(8, 8, 5, 5)),
        (relu,),
        (max_pool, 2),  # 8 x 14 x 14
        (convolution, *parameters(8, 8, 3, 3)),
        (relu,),  # 8 x 12 x 12
        (inner_product, *parameters(1024, 1152)),
        (relu,),
        (dropout, p, rng),
        (inner_product, *parameters(1024, 1024, std=0.001)),
        (relu,),
        (dropout, p, rng),
        (inner_product, *parameters(47, 1024, std=0.001)),  # the DoFs of the hand
    ]


def loss_and_gradients(network, hand, depth, joints):
    """One pass forwards and one backwards. The loss is Eq. 3 with lambda = 1."""
    x, N, backwards, gradients = depth, len(depth), [], []
    for layer, *arguments in network:
        x, backward = layer(x, *arguments)
        backwards.append(backward)
    X, hand_backward = hand_model(x, hand)
    above, below = np.maximum(x - hand.upper, 0), np.maximum(hand.lower - x, 0)
    beyond = np.where(hand.free, above - below, 0)
    position_loss = ((X - joints) ** 2).sum() / (2 * N)
    limit_loss = abs(beyond).sum() / N
    # x is read twice, so two gradients add
    dx = hand_backward((X - joints) / N) + np.sign(beyond) / N
    for backward in reversed(backwards):
        dx, of_parameters = backward(dx)
        gradients.insert(0, of_parameters)
    return position_loss + limit_loss, gradients


def train(network, hand, depth, joints, updates, batch=8, rate=0.003, momentum=0.9):
    """Stochastic gradient descent with momentum. Yields the loss before each update."""
    history = [[0, 0] for _ in network]
    for t in range(updates):
        rows = np.arange(t * batch, (t + 1) * batch) % len(depth)
        loss, gradients = loss_and_gradients(network, hand, depth[rows], joints[rows])
        yield loss
        for (_, *parameters), of_layer, h in zip(network, gradients, history):
            for i, (w, dw) in enumerate(zip(parameters, of_layer)):
                h[i] = momentum * h[i] + rate * dw
                w -= h[i]


# ------------------------------------------------------------------------------ what it has learned


def predict(network, hand, depth):
    """The joints (N, 31, 3), without dropout."""
    x = depth
    for layer, *arguments in network:
        if layer is not dropout:
            x, _ = layer(x, *arguments)
    return hand_model(x, hand)[0]


def error_mm(X, joints):
    """The mean distance of the joints from the true ones; 1 is half of the crop's edge, 150 mm."""
    return 150 * np.linalg.norm(X - joints, axis=2).mean()


def drawing(X, true, hand, rows=26):
    """Lines of text: the bones of a hand (31, 3), seen from the front, as o over the
    true ones as dots.
    """
    canvas = np.full((rows, 2 * rows), " ")
    parents = [p if p >= 0 else j for j, p in enumerate(hand.parent)]
    for joints, mark in ((true, "."), (X, "o")):
        bones = joints[parents] - joints
        points = np.concatenate([joints + s * bones for s in np.linspace(0, 1, 20)])
        x, y, _ = points.T
        row = np.rint((1 - y) / 2 * rows).clip(0, rows - 1)
        column = np.rint((1 + x) * rows).clip(0, 2 * rows - 1)
        canvas[row.astype(int), column.astype(int)] = mark
    return ["".join(line) for line in canvas]


if __name__ == "__main__":
    frames, hand = np.load(FRAMES), Skeleton(HAND)
    if "--check" in sys.argv:
        import check_nano  # the only part that needs netlib

        check_nano.report(frames, hand)
    else:
        network = new_network(np.random.default_rng(1), p=0.3)
        depth, joints = frames["depth"] / 127, frames["joints"]
        before = drawing(predict(network, hand, depth[:1])[0], joints[0], hand)
        for t, loss in enumerate(train(network, hand, depth[:32], joints[:32], updates=201)):
            if t % 20 == 0:  # the loss is that before the update; the errors are those after it
                X = predict(network, hand, depth)
                seen, others = error_mm(X[:32], joints[:32]), error_mm(X[32:], joints[32:])
                print(f"update {t:3}   loss {loss:5.2f}   error {seen:5.1f} mm", end="")
                print(f", in 32 other frames {others:5.1f} mm")
        print("the first frame before and after: the true hand as dots, the predicted one as o")
        for line in zip(before, drawing(X[0], joints[0], hand)):
            print(*line, sep="|")
