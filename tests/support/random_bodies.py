"""Random bodies: a tree of joints with random axes, limits and surface, and its pose."""

from __future__ import annotations

from pathlib import Path

import numpy as np

AXES = ("X", "Y", "Z", "NEG_X", "NEG_Y", "NEG_Z")
LONGEST = 0.8  # half-cubes from the root to the farthest end, so that the body fits in its cube


def write_body(folder: Path, seed: int, joints: int = 8) -> Path:
    """Write a skeleton, children before parents, and its prior; return the prior's path."""
    rng = np.random.default_rng(seed)
    parents = [-1] + [int(rng.integers(max(i - 3, 0), i)) for i in range(1, joints)]
    length = np.append(0.0, rng.uniform(0.3, 0.5, joints - 1))
    reach = np.zeros(joints)
    for i in range(1, joints):
        reach[i] = reach[parents[i]] + length[i]
    length *= min(1.0, LONGEST / reach.max())
    turns = rng.permutation(["X", "Y", "Z"])
    dofs = [f'dof {{ name: "root_{axis}" }}' for axis in "xyz"]
    dofs += [
        f'dof {{ name: "turn_{axis}" initial: {rng.uniform(-0.3, 0.3):.6f} }}' for axis in turns
    ]
    slides = " ".join(f'translate {{ axis: {axis.upper()} dof: "root_{axis}" }}' for axis in "xyz")
    spins = " ".join(f'rotate {{ axis: {axis} dof: "turn_{axis}" }}' for axis in turns)
    made, capsules, limited = [f'joint {{ name: "root" {slides} {spins} }}'], [], []
    names = ["root", *(f"joint_{i}" for i in range(1, joints))]
    for i in range(1, joints):
        bone = rng.integers(3)
        rotations = ""
        for axis in rng.permutation([a for a in range(3) if a != bone])[: 1 + rng.integers(2)]:
            name = f"dof_{len(dofs)}"
            lower, upper = -rng.uniform(0.1, 1.0), rng.uniform(0.1, 1.0)
            limits = f"lower: {lower:.6f} upper: {upper:.6f}"
            dofs.append(f'dof {{ name: "{name}" initial: {rng.uniform(-1, 1):.6f} {limits} }}')
            limited.append(name)
            rotations += f'rotate {{ axis: {AXES[axis + 3 * rng.integers(2)]} dof: "{name}" }} '
        along = f"bone {{ axis: {AXES[bone + 3 * rng.integers(2)]} length: {length[i]:.6f} }}"
        made.append(
            f'joint {{ name: "{names[i]}" parent: "{names[parents[i]]}" {rotations} {along} }}'
        )
        thick, thin = rng.uniform(0.06, 0.1), rng.uniform(0.04, 0.06)
        ends = f'from: "{names[parents[i]]}" to: "{names[i]}"'
        capsules.append(
            f'capsule {{ {ends} radius: {thick:.6f} radius: {thin:.6f} part: "{names[i]}" }}'
        )
    text = [f'name: "random{seed}"', *dofs, *made[::-1], "flesh {", *capsules, "}"]
    (folder / "body.prototxt").write_text("\n".join(text) + "\n")
    prior = [
        'skeleton: "body.prototxt" camera: "kinect2" cube_mm: 900',
        "depth { low: 1500 high: 2500 }",
    ]
    prior += ['center { joint: "root" } center_jitter: 10 penetration: 10 scale_std: 0.03']
    prior += [f'turn {{ dof: "turn_{axis}" std: 25 }}' for axis in turns]
    prior += [
        f"between {{ a: 1.5 b: 1.5 {' '.join(f'dof: {chr(34)}{name}{chr(34)}' for name in limited)} }}"
    ]
    path = folder / "body_prior.prototxt"
    path.write_text("\n".join(prior) + "\n")
    return path
