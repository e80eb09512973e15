"""The page about Table 1, in Markdown: the tables, what their figures mean, the findings, and the pictures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence

from handpose.experiments.table1 import true_angles
from handpose.experiments.table1.findings import FINDINGS, HALVES, decide
from handpose.experiments.table1.ledger import Entry
from handpose.experiments.table1.networks import LAMBDAS, NETWORKS
from handpose.experiments.table1.plan import (
    ASKED_OF_MANY,
    MATTERS,
    is_asked,
    lambdas,
    next_length,
    of_job,
    order,
    verdict,
)
from handpose.experiments.table1.recipes import ADAM, PAPER, RECIPES, Recipe
from handpose.experiments.table1.settings import MANY_HANDS, ONE_HAND, SETTINGS, Setting
from handpose.experiments.table1.speed import Speed
from handpose.experiments.table1.summary import Line, line_of, spread_text, value_of

PAPERS_FPS = 125  # one image after the other, on a GPU

HEAD = f"""\
# Table 1: does a hand model in the network help?

Made by `python tools/table1.py` (`make table1`) from the files in [table1](table1), one for each length of a
training that was scored. Synthetic data are made as they are needed, as by these commands, and `--setting nyu`
takes NYU from data/nyu:

<!-- not run: minutes, 10 GB -->
```bash
python tools/make_synthetic.py --recipe one_hand --out data/one_hand --train 72757 --test 4096
python tools/make_synthetic.py --recipe many_hands --out data/many_hands --train 72757 --test 4096
```

- Setting: training frames of one hand; test frames of the same hand, and of a second, smaller one (cube 261
  mm), as in NYU. Most hands are between two gestures, and palms are turned as much as those of NYU's test
  frames. Synthetic hands have exact angles, and fitted ones, as the paper had them. In `many_hands`, bones, flesh
  and sizes are those of many people.
- Length: a training is made half as long again, until that changes the joint error by less than {MATTERS:.0%}
  ("done") or raises it ("rises": the length before counts). At the paper's rate errors fall on and on: by its solver,
  whose file has 10,000 iterations, trainings end after {PAPER.lengths[-1]:,} ("falls"). "Not yet" is none of these.
  What is done by its joints may still change in its angles, and in the frames out of limits.
- Joint error: mean over the 14 joints compared on NYU, about the crop's centre (joint 34).
- Angle error: mean over the 23 free rotations, in canonical form, against the hand fitted to the true joints
  (31 joints, within the limits, ridge {true_angles.RIDGE:g}), and against the exact angles. Networks that
  predict joints get their angles by the same fit, without the ridge.
- Out of limits: frames with any predicted angle beyond its limits.
- ± is half of what lies between the seeds, where there are several. The paper's columns are NYU's: on other data
  they tell the order to expect, and not the size of the errors.
- A finding is a difference, positive where it speaks for the paper. It is confirmed or refuted when two seeds at
  least were trained long enough, all say the same, and say it by more than they differ. Two seeds are few: of
  differences that are none, this rule would decide three in ten, so trust those that are many times as large as what
  lies between their seeds. Where an error still falls, the mean difference must be so large that {HALVES} more halves,
  each changing it as much as the last did, would not turn it. Two networks are as good as each other if one is worse
  by less than {MATTERS:.0%}: "passes" says how much that is.
- Our recipe is that of synthetic_train_test.prototxt (Adam, batches of {ADAM.batch}, SmoothL1Loss with weight 0.1,
  PhysLimit with weight 1) with another rate, constant for the first 70% of the iterations, then in a straight line
  to 0; without augmentation, because angles cannot be augmented, and without the second head, because a network of
  joints alone has none. The paper's solver is that of nyu_solver.prototxt, its rate a tenth for the last tenth. So
  trainings of several lengths have their beginning in common."""

Ledger = Mapping[str, Sequence[Entry]]  # by setting


def joints_picture(recipe: Recipe) -> str:
    """The name of the picture of joint errors."""
    return f"table1_joints_{recipe.name}.png"


def angles_picture(recipe: Recipe) -> str:
    """The name of the picture of angle errors."""
    return f"table1_angles_{recipe.name}.png"


def hands_picture(recipe: Recipe) -> str:
    """The name of the picture of hands."""
    return f"table1_hands_{recipe.name}.jpg"


def lambda_picture(recipe: Recipe) -> str:
    """The name of the picture of the weight of PhysLimit."""
    return f"table1_lambda_{recipe.name}.png"


def lines_of(ledger: Ledger, setting: Setting, recipe: Recipe) -> dict[str, Line]:
    """The lines of a setting by a recipe, by network, in the order of the table."""
    entries = ledger.get(setting.name, ())
    found = {network.name: line_of(entries, setting, network, recipe) for network in NETWORKS}
    return {name: line for name, line in found.items() if line.verdicts}


def first_of(ledger: Ledger) -> Setting:
    """The setting that is nearest to the paper's, of those that have results: its figures are drawn."""
    return next((setting for setting in SETTINGS.values() if ledger.get(setting.name)), ONE_HAND)


def page_of(ledger: Ledger, speed: Speed | None = None) -> str:
    """The page."""
    first = first_of(ledger)
    lines = [HEAD, *_left(ledger, first)]
    for setting in (setting for setting in SETTINGS.values() if ledger.get(setting.name)):
        for recipe in RECIPES.values():
            found = lines_of(ledger, setting, recipe)
            if found:
                lines += ["", f"## {setting.title}: {recipe.title}", "", *_table(setting, found)]
                lines += _pictures(recipe, setting) if setting is first else []
                if setting is not MANY_HANDS:
                    lines += ["", *_findings(found, setting, recipe)]
                else:
                    lines += ["", *_people(found, first.title, lines_of(ledger, first, recipe))]
        for recipe in RECIPES.values() if setting is first else ():
            lines += _lambdas(ledger[setting.name], setting, recipe)
        lines += _provenance(ledger[setting.name])
    return "\n".join([*lines, "", *_speed(speed)]) + "\n"


def _left(ledger: Ledger, setting: Setting) -> list[str]:
    """How many trainings are missing, or not long enough yet, by setting and recipe, and by weight of PhysLimit."""
    due: dict[str, list[bool]] = {}
    for job in [*order(setting), *lambdas(ledger.get(setting.name, ()), setting)]:
        entries = ledger.get(job.setting.name, ())
        if job.only:
            what, is_due = "the weight of PhysLimit", next_length(entries, job) is not None
        else:
            what, is_due = job.recipe.title, verdict(of_job(entries, job), job.recipe.lengths).end == "not yet"
        due.setdefault(f"{job.setting.title}, {what}", []).append(is_due)
    left = [f"{where}: {sum(some)} of {len(some)}" for where, some in due.items() if any(some)]
    return ["", f"**Trainings that are still to be done:** {'; '.join(left)}."] if left else []


def _table(setting: Setting, lines: Mapping[str, Line]) -> Iterable[str]:
    names = list(setting.subjects) if len(setting.subjects) > 1 else []
    heads = ["network", "joint error, mm", *names, "angle error, fitted", "exact", "out of limits", "max ≤ 40 mm",
             "iterations", "long enough"]  # fmt: skip
    beside = setting is not MANY_HANDS  # which the paper does not have
    heads += ["the paper: joints", "angles"] if beside else []
    yield f"| {' | '.join(heads)} |"
    yield "|" + "---|" * len(heads)
    for line in lines.values():
        paper = line.network.paper
        cells = [
            line.network.title,
            _cell(line, "error_14_mm"),
            *(_cell(line, "error_14_mm", name) for name in names),
            _cell(line, "fitted_angle_deg", unit="°"),
            _cell(line, "angle_deg", unit="°"),
            _cell(line, "out_of_limits", form="{:.1%}"),
            _cell(line, "within_40_mm", form="{:.1%}"),
            ", ".join(f"{length:,}" for length in line.lengths),
            ", ".join(line.ends),
        ]
        if beside:
            cells += ["–", "–"] if paper is None else [f"{paper.error_14_mm} mm", f"{paper.fitted_angle_deg}°"]
        yield f"| {' | '.join(cells)} |"


def _cell(line: Line, figure: str, subject: str | None = None, form: str = "{:.2f}", unit: str = "") -> str:
    return spread_text(line.values(figure, subject).values(), form, unit)


def _findings(lines: Mapping[str, Line], setting: Setting, recipe: Recipe) -> list[str]:
    rows = ["What the paper found:", "", "| finding | here | difference by seed | the paper's |", "|---|---|---|---|"]
    there = {network.name for network in NETWORKS if network.is_for(setting) and is_asked(network, setting, recipe)}
    for finding in FINDINGS:
        if not set(finding.networks) <= there | set(lines):
            continue
        found = decide(finding, lines)
        differences = ", ".join(map(finding.form.format, found.differences)) or "–"
        if found.allowed:
            differences += f"; {finding.form.format(-found.allowed)} passes"
        paper = finding.form.format(finding.paper) if math.isfinite(finding.paper) else "–"
        why = f": {found.why}" if found.why else ""
        rows.append(f"| {finding.text} | **{found.word}**{why} | {differences} | {paper} |")
    return rows


def _people(lines: Mapping[str, Line], title: str, one_hand: Mapping[str, Line]) -> list[str]:
    """What a model of fixed bones costs where bones differ, and what gives it back; beside it the same of one hand."""
    rows = ["What the model costs when bones vary, and what gives it back:", "", "| | joint error, mm |", "|---|---|"]
    for name, line in lines.items():
        if name in ASKED_OF_MANY:
            ends = ", ".join(line.ends)
            early = f" ({ends})" if ends != "done" else ""
            rows.append(f"| {line.network.title}{early} | {_cell(line, 'error_14_mm')} |")
        if name == "ours":
            rows.append(f"| ours, its angles on the hand scaled to the person's size | {_cell(line, 'scaled_mm')} |")
            rows.append(f"| ours, its angles on the person's own bones | {_cell(line, 'own_bones_mm')} |")
    for where, found in ((MANY_HANDS.title, lines), (title, one_hand)):
        if {"ours", "direct_joint"} <= set(found):
            ours, joint = (found[name].values("error_14_mm") for name in ("ours", "direct_joint"))
            costs = [ours[seed] - joint[seed] for seed in sorted(set(ours) & set(joint))]
            rows.append(f"| ours more than direct joint, {where} | {spread_text(costs, '{:+.2f}')} |")
    return rows


def _pictures(recipe: Recipe, setting: Setting) -> list[str]:
    return [
        "",
        f"![Success curves and errors by joint, {setting.title}, {recipe.title}]({joints_picture(recipe)})",
        "",
        f"![Angle errors, {setting.title}, {recipe.title}]({angles_picture(recipe)})",
        "",
        "Held-out frames, the true hand in white:",
        "",
        f"![Hands, {setting.title}, {recipe.title}]({hands_picture(recipe)})",
    ]


def lambda_entries(entries: Sequence[Entry], recipe: Recipe) -> dict[tuple[float, str], Entry]:
    """The entries by weight and norm of PhysLimit, all of one length; nothing if only the usual ones are there."""
    of = {network.name: network.limit or ((0.0 if network.name == "no_limit" else 1.0), "L1") for network in LAMBDAS}
    found = [entry for entry in entries if entry.network in of and entry.seed == 1 and entry.recipe == recipe.name]
    special = {entry.iterations for entry in found if entry.network not in ("ours", "no_limit")}
    if not special:
        return {}
    length = max(special)
    return {of[entry.network]: entry for entry in found if entry.iterations == length}


def _lambdas(entries: Sequence[Entry], setting: Setting, recipe: Recipe) -> list[str]:
    found = lambda_entries(entries, recipe)
    if not found:
        return []
    truth = "exact" if setting.has_exact_angles else "fitted"
    rows = [f"| λ | norm | joint error, mm | angle error, {truth} | out of limits |", "|---|---|---|---|---|"]
    for (weight, norm), entry in sorted(found.items(), key=lambda item: (item[0][1], item[0][0])):
        angle = value_of(entry, "angle_deg" if setting.has_exact_angles else "fitted_angle_deg")
        rows.append(f"| {weight:g} | {norm if weight else '–'} | {value_of(entry, 'error_14_mm'):.2f} | {angle:.2f}° | "
                    f"{value_of(entry, 'out_of_limits'):.1%} |")  # fmt: skip
    length = next(iter(found.values())).iterations
    return [
        "",
        f"## {setting.title}: the weight of PhysLimit, {recipe.title}",
        "",
        f"Ours by {recipe.title}, {length:,} iterations, seed 1, with other weights λ and norms. The paper's is λ = 1, "
        "L1; what was released is L2.",
        "",
        *rows,
        "",
        f"![Errors over the weight of PhysLimit]({lambda_picture(recipe)})",
    ]


def _provenance(entries: Sequence[Entry]) -> list[str]:
    """Data, machines, hours."""
    hours: dict[str, float] = {}
    for entry in entries:
        where = f"{entry.machine}, {entry.threads} thread{'s' * (entry.threads != 1)}"
        hours[where] = hours.get(where, 0.0) + entry.seconds / 3600
    data = ", ".join(sorted({f"{entry.data} ({entry.made_from})" for entry in entries}))
    frames = sum(part.frames for part in entries[0].subjects)
    seeds = ", ".join(str(seed) for seed in sorted({entry.seed for entry in entries}))
    times = "; ".join(f"{where}: {spent:.1f} h" for where, spent in sorted(hours.items()))
    return [
        "",
        f"Data: {data}, {frames:,} test frames; seeds {seeds}. Training took {times}; lengths share their trunks, so "
        "less was spent.",
    ]


def _speed(speed: Speed | None) -> list[str]:
    rows = ["## Speed", ""]
    if speed is None:
        return [*rows, f"The paper: {PAPERS_FPS} frames per second on a GPU. Here not measured yet: "
                "`python tools/table1.py --speed`."]  # fmt: skip
    return [
        *rows,
        "| one forward pass of ours | frames per second |",
        "|---|---|",
        f"| the paper, a GPU | {PAPERS_FPS} |",
        f"| here, one frame at a time | {speed.single:,.0f} |",
        f"| here, {speed.batch} frames at a time | {speed.batched:,.0f} |",
        "",
        f"Engine {speed.engine}, {speed.threads} thread{'s' * (speed.threads != 1)}; {speed.machine}.",
    ]
