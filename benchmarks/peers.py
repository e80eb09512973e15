"""The paper's network in PyTorch, with the same weights."""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from benchmarks.paper import WEIGHTS
from fast.kinematics import FastKinematics
from layers.hand.kinematics import rotation
from layers.hand.skeleton import Motion, Skeleton
from netlib.net import Net


class TorchHandByJoint(nn.Module):
    """Forward kinematics for autograd as in the paper: products of 4 x 4 transforms, from root to tip."""

    def __init__(self, skeleton: Skeleton) -> None:
        super().__init__()
        self.skeleton = skeleton
        self.initial = torch.tensor(skeleton.initial, dtype=torch.float32)
        self.steps = [self._steps(joint) for joint in range(len(skeleton.joint_names))]
        self.bones = []
        for axis, length in zip(skeleton.bone_axes, skeleton.bones):
            T = torch.eye(4)
            if axis >= 0:
                T[axis, 3] = length
            self.bones.append(T)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map inputs (N, D) to joints (N, 3 K)."""
        theta = x + self.initial
        done: dict[int, torch.Tensor] = {}

        def of(joint: int) -> torch.Tensor:
            if joint in done:
                return done[joint]
            parent = int(self.skeleton.parents[joint])
            M = torch.eye(4).expand(len(x), 4, 4) if parent < 0 else of(parent)
            for step in self.steps[joint]:
                M = M @ (step if isinstance(step, torch.Tensor) else self._motion(step, theta))
            done[joint] = M @ self.bones[joint]
            return done[joint]

        return torch.stack([of(j)[:, :3, 3] for j in range(len(self.bones))], 1).reshape(len(x), -1)

    def _steps(self, joint: int) -> list[torch.Tensor | Motion]:
        """Return the joint's motions in order, with fixed rotations as transforms (4, 4)."""
        steps: list[torch.Tensor | Motion] = []
        for motion in self.skeleton.motions[joint]:
            if motion.kind == "translate" or motion.row >= 0:
                steps.append(motion)
                continue
            T = torch.eye(4)
            turned = rotation(motion.axis, motion.sign * self.skeleton.initial[motion.dof])
            T[:3, :3] = torch.tensor(turned, dtype=torch.float32)
            steps.append(steps.pop() @ T if steps and isinstance(steps[-1], torch.Tensor) else T)
        return steps

    @staticmethod
    def _motion(step: Motion, theta: torch.Tensor) -> torch.Tensor:
        """Return the transforms (N, 4, 4) of one motion."""
        T = torch.eye(4).repeat(len(theta), 1, 1)
        t = step.sign * theta[:, step.dof]
        if step.kind == "translate":
            T[:, step.axis, 3] = t
            return T
        i, j = (step.axis + 1) % 3, (step.axis + 2) % 3
        c, s = torch.cos(t), torch.sin(t)
        T[:, i, i], T[:, i, j], T[:, j, i], T[:, j, j] = c, -s, s, c
        return T


class TorchHand(nn.Module):
    """Faster forward kinematics: 3 x 3 matrices, joints of the same depth and kind batched."""

    def __init__(self, skeleton: Skeleton) -> None:
        super().__init__()
        self.kinematics = FastKinematics(skeleton)
        self.register_buffer("initial", torch.tensor(skeleton.initial, dtype=torch.float32))
        self.register_buffer("free", torch.tensor(~skeleton.fixed))
        self.register_buffer("bones", torch.tensor(skeleton.bones, dtype=torch.float32))
        for i, group in enumerate(self.kinematics.groups):
            for s, do in enumerate(group.operations):
                if do.kind == "constant":
                    self.register_buffer(f"c{i}_{s}", torch.tensor(do.matrices, dtype=torch.float32))
                elif do.kind == "rotate":  # R(t) = P + cos t Q + sin t S
                    R0, R1, Rpi = (rotation(do.axis, a) for a in (0.0, np.pi / 2, np.pi))
                    P = (R0 + Rpi) / 2
                    parts = np.array([P, R0 - P, R1 - P])
                    self.register_buffer(f"r{i}_{s}", torch.tensor(parts, dtype=torch.float32))
                    self.register_buffer(f"s{i}_{s}", torch.tensor(do.sign[:, 0, 0], dtype=torch.float32))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map inputs (N, D) to joints (N, 3 K)."""
        N = len(x)
        theta = torch.where(self.free, x, torch.zeros((), dtype=x.dtype)) + self.initial
        X: list[torch.Tensor] = [x] * len(self.bones)
        frames: list[torch.Tensor] = []
        for i, group in enumerate(self.kinematics.groups):
            if group.parent < 0:
                F = torch.eye(3).expand(N, 1, 3, 3)
                p = torch.zeros(N, 1, 3)
            else:
                parent = self.kinematics.groups[group.parent]
                F = frames[group.parent][:, group.slots]
                p = torch.stack([X[j] for j in parent.joints], 1)[:, group.slots]
            for s, do in enumerate(group.operations):
                dofs = self.kinematics.dof_of[do.rows]
                if do.kind == "constant":
                    F = F @ getattr(self, f"c{i}_{s}")
                elif do.kind == "translate":
                    p = p + F[..., do.axis] * theta[:, dofs, None]
                else:
                    P, Q, S = getattr(self, f"r{i}_{s}")
                    t = theta[:, dofs] * getattr(self, f"s{i}_{s}")
                    F = F @ (P + torch.cos(t)[..., None, None] * Q + torch.sin(t)[..., None, None] * S)
            at = p + F[..., group.bone_axis] * self.bones[group.joints][:, None]
            for n, j in enumerate(group.joints):
                X[j] = at[:, n]
            frames.append(F)
        return torch.stack(X, 1).reshape(N, -1)


class TorchNet(nn.Module):
    """The paper's network with its hand model."""

    def __init__(self, net: Net, skeleton: Skeleton) -> None:
        super().__init__()
        self.conv = nn.Sequential(
            nn.Conv2d(1, 8, 5), nn.ReLU(), nn.MaxPool2d(4),
            nn.Conv2d(8, 8, 5), nn.ReLU(), nn.MaxPool2d(2, ceil_mode=True),
            nn.Conv2d(8, 8, 3), nn.ReLU(), nn.Flatten(),
        )
        self.fc = nn.Sequential(
            nn.Linear(1152, 1024), nn.ReLU(), nn.Dropout(0.3), nn.Linear(1024, 1024), nn.ReLU(), nn.Dropout(0.3),
            nn.Linear(1024, 47),
        )
        self.hand = TorchHand(skeleton)
        self.lower = torch.tensor(np.where(skeleton.fixed, -np.inf, skeleton.lower), dtype=torch.float32)
        self.upper = torch.tensor(np.where(skeleton.fixed, np.inf, skeleton.upper), dtype=torch.float32)
        layers = [m for m in [*self.conv, *self.fc] if isinstance(m, (nn.Conv2d, nn.Linear))]
        with torch.no_grad():
            for name, layer in zip(WEIGHTS, layers):
                layer.weight.copy_(torch.from_numpy(net.params[name][0].data))
                layer.bias.copy_(torch.from_numpy(net.params[name][1].data))
        self.trained = layers

    def angles(self, depth: torch.Tensor) -> torch.Tensor:
        """Map depth (N, 1, 128, 128) to angles (N, 47)."""
        return self.fc(self.conv(depth))

    def forward(self, depth: torch.Tensor) -> torch.Tensor:
        """Map depth (N, 1, 128, 128) to joints (N, 93)."""
        return self.hand(self.angles(depth))

    def loss(self, depth: torch.Tensor, joint: torch.Tensor) -> torch.Tensor:
        """Return the paper's loss per frame: half the squared distance plus a linear hinge on the joint limits."""
        x = self.angles(depth)
        hinge = torch.relu(x - self.upper).sum() + torch.relu(self.lower - x).sum()
        return ((self.hand(x) - joint) ** 2).sum() / (2 * len(depth)) + hinge / len(depth)
