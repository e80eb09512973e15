"""The page about Table 1, in Markdown: the table, what its figures mean, the findings, and the pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from handpose.experiments import true_angles
from handpose.experiments.networks import Network
from handpose.experiments.results import Result, findings

JOINTS, ANGLES, HANDS = "table1_joints.png", "table1_angles.png", "table1_hands.jpg"  # the pictures


def page_of(
    networks: Sequence[Network], results: Mapping[str, Result], made_from: str, frames: int, iterations: int, seed: int
) -> str:
    """The page.

    results    by the names of the networks, on ``frames`` test frames
    made_from  what the data are: "NYU" or another origin
    """
    rows = [
        "| network | joint error, mm | angle error | out of limits | max ≤ 40 mm "
        "| the paper on NYU: joint error, mm | angle error |",
        "|---|---|---|---|---|---|---|",
    ]
    for network in networks:
        r = results[network.name]
        broken = "–" if r.out_of_limits is None else f"{r.out_of_limits:.1%}"
        paper = "– | –" if network.paper is None else f"{network.paper[0]:.1f} | {network.paper[1]:.1f}°"
        rows.append(f"| {network.title} | {r.error_14_mm:.2f} | {r.angle_deg:.2f}° | {broken} | "
                    f"{r.within_40_mm:.1%} | {paper} |")  # fmt: skip
    comparable = (
        "The data are the paper's, so joint errors, angle errors and the order of the networks are comparable with its "
        "columns, up to the number of iterations."
        if made_from == "NYU"
        else "The data are not the paper's, so its columns tell the order to expect and not the size of the errors."
    )
    return "\n".join([
        "# Table 1: does a hand model in the network help?",
        "",
        f"Made by `python tools/table1.py --iterations {iterations} --seed {seed}` (`make table1`) on "
        f"data/nyu ({made_from}); every network with the paper's solver, batches of 512, one seed. Scored on "
        f"{frames} held-out frames.",
        "",
        *rows,
        "",
        "- Joint error: mean over the 14 joints compared on NYU, about the crop's centre (joint 34), cube 300 mm "
        "(261 mm for NYU's second subject).",
        "- Angle error: mean over the 23 free rotations, in canonical form, against the hand fitted to the annotated "
        f"joints (31 joints, within the limits, ridge {true_angles.RIDGE:g}). Networks that predict joints get their "
        "angles by the same fit, without the ridge.",
        "- Out of limits: frames with any predicted angle beyond its limits. The paper: 18.6% without the physical "
        "constraint, 0.9% with it.",
        f"- {comparable}",
        "",
        "What the paper found, and what these trainings say:",
        "",
        *findings(results),
        "",
        f"![Success curves and errors by joint]({JOINTS})",
        "",
        f"![Angle errors]({ANGLES})",
        "",
        "Held-out frames, the annotated hand in white:",
        "",
        f"![Hands]({HANDS})",
        "",
    ])  # fmt: skip
