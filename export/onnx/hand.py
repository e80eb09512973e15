"""HandModel in ONNX: forward kinematics as a few products of 4 x 4 matrices, batched
over all limbs.

The transform of a motion by theta (layers/hand/kinematics.py) combines four constant matrices:

    A(theta) = A_1 + A_cos cos theta + A_sin sin theta + A_theta theta

Fixed DoFs and bones are also constant and are multiplied into the following motions. The remaining
tree contains only free motions, called steps:

    world_from_step = world_from_parent @ S(theta)         S = (fixed transform between the two) @ A
    joint           = world_from_step @ (fixed transform after the joint's last step) @ (0, 0, 0, 1)

Steps of the same depth in this tree form one product. The NYU hand has 26 free motions, at most
10 in a chain.

If each body has its own bone lengths (bottom[1]), a fixed transform is a constant plus, for each
bone, a constant times its length, as bones only translate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from export.onnx.graph import Graph, LayerCall, Shape
from layers.hand.kinematics import rotation
from layers.hand.skeleton import Motion, Skeleton
from netlib.blob import Array

PARTS = ("one", "cosine", "sine", "angle")  # factors of the four matrices of a step


@dataclass(frozen=True)
class Step:
    """A free motion with the fixed transform between it and its parent.

    parent  index of the parent step
    depth   number of steps from the root
    dof     index of its DoF
    parts   (4, 4, 4) the matrices of 1, cos theta, sin theta, theta
    """

    parent: int
    depth: int
    dof: int
    parts: Array


def hand_model(graph: Graph, call: LayerCall) -> list[str]:
    """Compute the joints of a pose."""
    sk: Skeleton = call.layer.skeleton
    of_fixed_size = len(call.values) == 1
    body = sk if of_fixed_size else sk.with_free_slides()  # as the layer does
    steps, last, offsets = steps_of(body, sk.bones if of_fixed_size else 0 * sk.bones)
    x = call.values[0]
    if len(call.bottom[0]) != 2:
        x = graph.reshaped(x, ("N", len(sk.dof_names)))
    dofs = [step.dof for step in steps]
    moved = graph.op("Gather", x, graph.constant(dofs, "dofs"), axis=1)
    parts = np.stack([step.parts for step in steps], axis=1)  # (4, steps, 4, 4)
    one, cosine, sine, angle = map(graph.constant, parts, PARTS)
    ends_at = graph.constant(offsets[:, None], "offsets")
    if of_fixed_size:
        initial = graph.constant(sk.initial[dofs], "initial")
    else:
        is_free = graph.constant(1.0 - sk.fixed[dofs], "is_free")
        moved = graph.op("Mul", moved, is_free)
        initial, bones = _size(graph, call, sk, dofs)
        by_step, by_joint = _per_bone(body, steps, offsets)
        one = graph.op("Add", one, _times(graph, bones, by_step, ("N", len(steps), 4, 4)))
        ends_at = graph.op("Add", ends_at, _times(graph, bones, by_joint, ("N", len(last), 1, 4)))
    theta = graph.reshaped(graph.op("Add", moved, initial), ("N", len(steps), 1, 1))
    transforms = _transforms(graph, theta, one, cosine, sine, angle)
    worlds = _worlds(graph, steps, transforms)
    frames = graph.op("Gather", worlds, graph.constant(last, "steps"), axis=1)
    terms = graph.op("Mul", frames, ends_at)  # not MatMul, which is wrong in OpenCV 5.0
    ends = graph.op("ReduceSum", terms, graph.constant([3], "axes"), keepdims=0)  # (N, K, 4)
    return [graph.reshaped(graph.sliced(ends, [0], [3], [2]), call.top[0])]


def _transforms(graph: Graph, theta: str, one: str, cosine: str, sine: str, angle: str) -> str:
    """Compute A(theta) of each step, (N, steps, 4, 4), for its four matrices."""
    cosines = graph.op("Mul", graph.op("Cos", theta), cosine)
    sines = graph.op("Mul", graph.op("Sin", theta), sine)
    turned = graph.op("Add", cosines, sines)
    slid = graph.op("Add", one, graph.op("Mul", theta, angle))
    return graph.op("Add", turned, slid)


def _size(graph: Graph, call: LayerCall, sk: Skeleton, dofs: list[int]) -> tuple[str, str]:
    """Compute the initial values, (N, steps) or (steps), and bone lengths (N, K) of bodies with
    individual sizes.
    """
    sizes = math.prod(call.sizes(call.bottom[1][1:]))
    b = call.values[1]
    if len(call.bottom[1]) != 2:
        b = graph.reshaped(b, ("N", sizes))
    if sizes > 1:
        return graph.constant(sk.initial[dofs], "initial"), b
    angles, slides = (
        graph.constant((sk.initial * which)[dofs], "initial") for which in (~sk.slides, sk.slides)
    )
    initial = graph.op("Add", angles, graph.op("Mul", b, slides))
    return initial, graph.op("Mul", b, graph.constant(sk.bones, "bones"))


def _per_bone(sk: Skeleton, steps: list[Step], positions: Array) -> tuple[Array, Array]:
    """Return what a bone of length 1 adds: (K, steps, 4, 4) to the constant matrices of the steps,
    and (K, K, 4) to the positions of the joints, which are given for bones of length 0.
    """
    by_step, by_joint = [], []
    for bones in np.diag(1.0 * (sk.bone_axes >= 0)):
        longer, _, moved = steps_of(sk, bones)
        by_step.append([b.parts[0] - a.parts[0] for a, b in zip(steps, longer)])
        by_joint.append(moved - positions)
    return np.array(by_step), np.array(by_joint)


def _times(graph: Graph, bones: str, by_bone: Array, shape: Shape) -> str:
    """Sum constants (K, ...) over the bones, weighted by their lengths (N, K); returns
    the given shape.
    """
    flat = graph.constant(by_bone.reshape(len(by_bone), -1), "by_bone")
    return graph.reshaped(graph.op("MatMul", bones, flat), shape)


def _worlds(graph: Graph, steps: list[Step], transforms: str) -> str:
    """Compute world_from_step of all steps, (N, steps, 4, 4)."""
    levels: list[list[int]] = [[] for _ in range(steps[-1].depth + 1)]
    for i, step in enumerate(steps):
        levels[step.depth].append(i)
    if len(levels) == 1:
        return transforms
    sizes = graph.constant([len(level) for level in levels], "split")
    by_level = graph.ops("Split", len(levels), transforms, sizes, axis=1)
    worlds = by_level[:1]
    for above, level, transform in zip(levels, levels[1:], by_level[1:]):
        parents = [above.index(steps[i].parent) for i in level]
        parent_worlds = worlds[-1]
        if parents != list(range(len(above))):
            indices = graph.constant(parents, "parents")
            parent_worlds = graph.op("Gather", parent_worlds, indices, axis=1)
        worlds.append(graph.op("MatMul", parent_worlds, transform))
    return graph.op("Concat", *worlds, axis=1)


def steps_of(sk: Skeleton, bones: Array) -> tuple[list[Step], list[int], Array]:
    """Return the steps by depth, the last step of each joint, and the joints' positions in the
    frames of these steps, (K, 4), for signed ``bones`` (K,).

    The first step is the identity; roots and everything fixed to them are its children.
    """
    no_motion = np.stack([np.eye(4), *np.zeros((3, 4, 4))])
    steps = [Step(-1, 0, 0, no_motion)]
    # Maps a joint to its last step and to step_from_joint.
    ends: dict[int, tuple[int, Array]] = {-1: (0, np.eye(4))}
    for j in sk.order:
        step, fixed = ends[int(sk.parents[j])]
        for motion in sk.motions[j]:
            parts = _parts(motion)
            if motion.row < 0:
                fixed = fixed @ _transform(parts, sk.initial[motion.dof])
            else:
                steps.append(Step(step, steps[step].depth + 1, motion.dof, fixed @ parts))
                step = len(steps) - 1
                fixed = np.eye(4)
        bone = np.eye(4)
        bone[sk.bone_axes[j], 3] += bones[j]  # without a bone: any axis, length 0
        ends[j] = step, fixed @ bone
    order = sorted(range(len(steps)), key=lambda i: steps[i].depth)
    new_index = {-1: -1, **{i: new for new, i in enumerate(order)}}
    sorted_steps = [replace(steps[i], parent=new_index[steps[i].parent]) for i in order]
    of_joints = [ends[j] for j in range(len(sk.joint_names))]
    last = [new_index[step] for step, _ in of_joints]
    positions = np.stack([step_from_joint[:, 3] for _, step_from_joint in of_joints])
    return sorted_steps, last, positions


def _transform(parts: Array, theta: float) -> Array:
    """Return the transform (4, 4) of a motion by theta."""
    one, cosine, sine, angle = parts
    return np.asarray(one + np.cos(theta) * cosine + np.sin(theta) * sine + theta * angle)


def _parts(motion: Motion) -> Array:
    """Return the matrices (4, 4, 4) of 1, cos theta, sin theta, theta in the
    transform of a motion.
    """
    parts = np.zeros((4, 4, 4))
    parts[0, 3, 3] = 1
    if motion.kind == "translate":
        parts[0] = np.eye(4)
        parts[3, motion.axis, 3] = motion.sign
    else:
        quarter = rotation(motion.axis, np.pi / 2)
        half = rotation(motion.axis, np.pi)
        parts[0, :3, :3] += (np.eye(3) + half) / 2  # projection onto the axis
        parts[1, :3, :3] = (np.eye(3) - half) / 2
        parts[2, :3, :3] = motion.sign * (quarter - parts[0, :3, :3])
    return np.round(parts)  # entries are -1, 0, 1; rotation() leaves 1e-16
