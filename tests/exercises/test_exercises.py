"""Every stub fails, every solution passes, every known mistake gets its own advice, and options
come one by one.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

import numpy as np
import pytest

from exercises import recorded
from exercises.check import Step, in_network, loaded, steps
from exercises.exercise import Exercise, Mistake, edited, module_of
from exercises.stubs import bugs, stub
from exercises.table import EXERCISES
from layers import LAYER_TYPES
from netlib.updates import RULES
from tests.exercises import reduce_recordings
from tests.exercises.solutions import CONVOLUTION, POOLING, WITHOUT

exercises = pytest.mark.parametrize("exercise", EXERCISES.values(), ids=list(EXERCISES))
MISTAKES = [
    pytest.param(exercise, mistake, id=f"{exercise.name}-{number}")
    for exercise in EXERCISES.values()
    for number, mistake in enumerate(exercise.mistakes, 1)
]
RELU = {
    "reshape": "top[0].reshape(bottom[0].shape)",
    "forward": "top[0].data[...] = np.where(bottom[0].data > 0, 1, self.slope) * bottom[0].data",
    "backward": """
if propagate_down[0]:
    bottom[0].diff[...] = np.where(bottom[0].data > 0, 1, self.slope) * top[0].diff
""",
}


def filled(name: str, bodies: dict[str, str]) -> str:
    """Return the stub with these bodies, by the names of the functions."""
    text = stub(EXERCISES[name], "exercise")
    for function, body in bodies.items():
        before, head, after = text.partition(f"    def {function}(")
        indented = "\n".join(f"        {line}" for line in body.strip("\n").splitlines())
        text = before + head + after.replace("        raise NotImplementedError", indented, 1)
    return text


def last_step(name: str, text: str) -> Step:
    *_, step = steps(EXERCISES[name], module_of(text, f"{name}.py", f"a solution of {name}"))
    return step


def lines_of(name: str, bodies: dict[str, str]) -> str:
    step = last_step(name, filled(name, bodies))
    assert not step.passed
    return "\n".join(step.lines)


def test_there_are_12_exercises_with_5_mistakes_each() -> None:
    chapters = [exercise.chapter for exercise in EXERCISES.values()]
    assert len(EXERCISES) == 12
    assert chapters == sorted(chapters)
    assert set(chapters) == set(range(1, 11))
    for exercise in EXERCISES.values():
        assert (
            len({mistake.advice for mistake in exercise.mistakes})
            == len(bugs(exercise, "exercise"))
            == 5
        )


@exercises
def test_a_stub_fails_and_says_what_to_write_first(exercise: Exercise, tmp_path: Path) -> None:
    text, path = stub(exercise, "exercise"), tmp_path / "mine.py"
    path.write_text(text, encoding="utf-8")
    assert ast.get_docstring(ast.parse(text)) == ast.get_docstring(ast.parse(exercise.source()))
    assert text.count("raise NotImplementedError") == len(exercise.to_do)
    words = " ".join(line.strip().lstrip("# ") for line in text.splitlines())
    assert all(" ".join(task.split()) in words for task in exercise.to_do.values())
    *_, step = steps(exercise, loaded(exercise, path), path)
    name, _, place = step.lines[0].partition(f" is not written yet: {path}:")
    assert not step.passed
    assert any(task.split(".")[-1] == name for task in exercise.to_do)
    assert (
        text.splitlines()[int(place.removesuffix(".")) - 1].strip() == "raise NotImplementedError"
    )


@exercises
def test_the_projects_source_passes(exercise: Exercise) -> None:
    before = dict(LAYER_TYPES), dict(RULES)
    part = module_of(exercise.source(), exercise.file, f"the source of {exercise.name}")
    made = [
        *steps(exercise, part),
        in_network(exercise, part, 20 if exercise.name == "relu" else 2),
    ]
    assert [step for step in made if not step.passed] == []
    assert len(made) == len(exercise.checks) + 1
    assert before == (LAYER_TYPES, RULES)


@pytest.mark.parametrize(("exercise", "mistake"), MISTAKES)
def test_a_mistake_gets_its_own_advice(exercise: Exercise, mistake: Mistake) -> None:
    for text in mistake.sources(exercise):
        lines = last_step(exercise.name, text).lines
        given = [
            other.advice
            for other in exercise.mistakes
            if any(line.endswith(other.advice) for line in lines)
        ]
        assert given == [mistake.advice]


@exercises
def test_mistakes_do_not_depend_on_layout(
    exercise: Exercise, monkeypatch: pytest.MonkeyPatch
) -> None:
    as_written = [
        ast.unparse(ast.parse(text))
        for mistake in exercise.mistakes
        for text in mistake.sources(exercise)
    ]
    laid_out = ast.unparse(ast.parse(exercise.source()))
    monkeypatch.setattr(Exercise, "source", lambda self: laid_out)
    otherwise = [
        ast.unparse(ast.parse(text))
        for mistake in exercise.mistakes
        for text in mistake.sources(exercise)
    ]
    assert otherwise == as_written


@pytest.mark.parametrize(("code", "count"), [("z = x", 0), ("f(x)", 2), ("x + 1", 0)])
def test_code_that_does_not_occur_exactly_once_is_an_error(code: str, count: int) -> None:
    with pytest.raises(ValueError, match=f"^{count} times '{re.escape(code)}'"):
        edited("y = f(x)\nz = f(x) + 1\n", code, "pass")


@pytest.mark.parametrize(
    ("name", "bodies"), [("convolution", CONVOLUTION), ("pooling", POOLING), ("relu", RELU)]
)
def test_a_solution_with_plain_loops_passes(name: str, bodies: dict[str, str]) -> None:
    assert last_step(name, filled(name, bodies)).passed


def test_the_recorded_numbers_are_caffes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    mine = recorded.everything()
    monkeypatch.setattr(recorded, "FILE", tmp_path / "again.npz")
    reduce_recordings.main()
    theirs = np.load(recorded.FILE)
    assert mine.keys() == theirs.keys()
    assert all(
        np.array_equal(mine[name], array) and mine[name].dtype == array.dtype
        for name, array in theirs.items()
    )
    assert recorded.FILE.stat().st_size < 180_000  # it is installed


KERNEL, STRIDE = "kernel_h: 2 kernel_w: 3", "stride_h: 2 stride_w: 3"
PAD, DIL, KEPT = "pad_h: 1 pad_w: 2", "dilation: 2 dilation: 3", "propagate_down: false"


@pytest.mark.parametrize(
    ("name", "attribute"),
    [
        (name, attribute)
        for name in ("convolution", "pooling")
        for attribute in ("kernel", "stride", "pad")
    ]
    + [("convolution", "dilation")],
)
@pytest.mark.parametrize(
    "methods", [("_outputs",), ("forward",), ("backward",), ("_outputs", "forward", "backward")]
)
def test_exchanged_axes_are_an_error(name: str, attribute: str, methods: tuple[str, ...]) -> None:
    bodies = dict({"convolution": CONVOLUTION, "pooling": POOLING}[name])
    for method in methods:
        exchanged = re.sub(
            rf"self\.(whole_)?{attribute}\b(?!\[i\])", rf"self.\1{attribute}[::-1]", bodies[method]
        )
        bodies[method] = exchanged.replace(f"{attribute}[i]", f"{attribute}[1 - i]")
    lines_of(name, bodies)


@pytest.mark.parametrize(
    "name", [name for name, exercise in EXERCISES.items() if "shapes" in exercise.checks[0].title]
)
def test_a_backward_that_ignores_propagate_down_is_explained(name: str) -> None:
    text = re.sub(
        r"\bif (not )?(propagate_down\[0\]|down):", r"if \1True:", EXERCISES[name].source()
    )
    step = last_step(name, text)
    assert not step.passed
    assert step.title == "with propagate_down: false"
    assert any(
        "If propagate_down is false for a bottom, backward must not" in line for line in step.lines
    )


def without(options: str, *methods: str) -> dict[str, str]:
    """Return the convolution without these options, in some methods or in all."""
    bodies = dict(CONVOLUTION)
    for method in methods or bodies:
        for option in options.split():
            bodies[method] = bodies[method].replace(*WITHOUT[option])
    return bodies


@pytest.mark.parametrize(
    ("bodies", "said"),
    [
        (
            without("bias_term stride pad dilation group"),
            f"with {KERNEL}, {KEPT}; bias_term: false is not handled in forward, nor {STRIDE}, {PAD}, {DIL}",
        ),
        (
            without("stride pad dilation group"),
            f"{STRIDE} is not handled, nor {PAD}, {DIL}, group: 2, a combination",
        ),
        (
            without("stride pad", "forward"),
            f"{STRIDE} is not handled in forward, nor {PAD}, a combination",
        ),
        (
            without("stride", "backward"),
            f"{STRIDE} is not handled in backward, nor a combination of options.",
        ),
        (
            without("pad dilation group"),
            f"{STRIDE}, {KEPT}; {PAD} is not handled, nor {DIL}, group: 2, a",
        ),
        (
            without("dilation group"),
            f"{PAD}, {KEPT}; {DIL} is not handled, nor group: 2, a combination",
        ),
        (without("group"), "; group: 2 is not handled in forward, nor a combination of options."),
    ],
)
def test_the_next_option_of_a_convolution_is_named_at_each_stage(
    bodies: dict[str, str], said: str
) -> None:
    lines = lines_of("convolution", bodies)
    assert lines.splitlines()[1].startswith("This passes without options")
    assert said in lines
    assert "not a known mistake" not in lines
    assert "shapes do not fit" not in lines


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "if self.is_max",
            "if True",
            "; pool: AVE is not handled in forward, nor AVE and an overlap of windows",
        ),
        (
            "+= dy[n, c, h, v] /",
            "= dy[n, c, h, v] /",
            "AVE and an overlap of windows is not handled in backward",
        ),
        ("+= dy[n, c, h, v] /", "= dy[n, c, h, v] /", "dx is assigned where it must be added to"),
        ("+= dy[n, c, h, v]\n", "= dy[n, c, h, v]\n", "dx is assigned where it must be added to"),
        (
            "/ area[h, v]",
            "/ k / l",
            "; AVE and a size that is rounded up is not handled in forward, nor AVE and pad",
        ),
    ],
)
def test_the_next_option_of_a_pooling_is_named(old: str, new: str, said: str) -> None:
    lines = lines_of("pooling", {name: body.replace(old, new) for name, body in POOLING.items()})
    assert said in lines
    assert "not a known mistake" not in lines


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"forward": "top[0].data = 0"}, "write into them, with [...] = or [...] += on"),
        (
            {"forward": "y = np.maximum(bottom[0].data, 0)"},
            "NaN, their initial value. Write every element",
        ),
        (
            {"backward": "bottom[0].diff[bottom[0].data > 0] = 1"},
            "backward must assign every element, also zeros",
        ),
        (
            {"forward": "top[0].data[...] = np.random.rand(*top[0].shape)"},
            "changes from call to call: draw random",
        ),
        ({"forward": "raise SystemExit(3)"}, "SystemExit: 3\nThe input was: bottom (2, 3, 4)."),
    ],
)
def test_typical_errors_of_beginners_are_explained(changes: dict[str, str], said: str) -> None:
    assert said in lines_of("relu", RELU | changes)


def test_the_network_finds_what_small_examples_do_not() -> None:
    exercise = EXERCISES["relu"]
    later = "self.calls = getattr(self, 'calls', 0) + (top[0].count > 1000)\nif self.calls > 1: top[0].data[...] = 0"
    part = module_of(
        filled("relu", RELU | {"forward": f"{RELU['forward']}\n{later}"}), "relu.py", "a solution"
    )
    assert all(step.passed for step in steps(exercise, part))
    step = in_network(exercise, part, 2)
    assert not step.passed
    assert step.lines[0].startswith("The loss of iteration ")


X_AND_DY = "x, dy = self.rows(bottom[0].data), self.rows(top[0].diff)"
SUMMED = "bottom[0].diff[...] = top[0].diff\nfor y in top[1:]:\n    bottom[0].diff[...] += y.diff"
IN_FIRST = "for y in top[1:]:\n    top[0].diff[...] += y.diff\nbottom[0].diff[...] = top[0].diff"
DRAW = "self.rng.integers(0, 1 << 16, bottom[0].shape, dtype=np.uint16)"
INDEX = "(h * sh - ph + i) * W + w * sw - pw + j"
WRITTEN = "pose.axis[:, motion.row], pose.pivot[:, motion.row] = a, p"
SGD = "h *= p.momentum\nh += rate * g\nw -= h"
ONLY_IF_DOWN = f"if not propagate_down[0]:\n    return\n{X_AND_DY}"
EXTENT = "(x.shape[2] + 2 * self.pad[0] - self._extent()[0])"
CEIL = f"return [-(-{EXTENT} // self.stride[0]) + 1, counts[1]]"
DX = "bottom[0].diff[...] = np.where(x > 0, dy, self.slope * dy)"


@pytest.mark.parametrize(
    ("name", "old", "new", "said"),
    [
        ("relu", DX, "dy[x <= 0] *= self.slope\nbottom[0].diff[...] = dy", "such as top[0].diff"),
        (
            "relu",
            "np.where(x > 0, x, self.slope * x)",
            "np.maximum(x, self.slope * x)",
            "_slope is",
        ),
        ("inner_product", X_AND_DY, ONLY_IF_DOWN, "needed, also those of the parameters"),
        (
            "inner_product",
            "dy @ w",
            "x @ w.T @ w * 0 + np.multiply(dy, 2, out=dy) @ w / 2",
            "dy[n=",
        ),
        ("convolution", "zip(bottom, top, propagate_down)", "[*zip(bottom, top, [1])]", "dx_1[n="),
        ("convolution", "return counts", CEIL, "stride_h: 2 stride_w: 3 is not handled"),
        ("pooling", INDEX, "(h * sh + i) * W + w * sw + j", "mask[n=0, c=0, h=0, w=0]"),
        ("pooling", INDEX, f"{INDEX} + _", "a second top is not handled in forward"),
        ("pooling", "any(self.pad)", "pad", "padding is not handled"),
        ("split", SUMMED, IN_FIRST, "dy_0[n="),
        ("split", "y.diff", "y.diff.astype('float32')", "precision of float32"),
        ("euclidean_loss", "a - b", "vars(self).setdefault('kept', a - b)", "from the first batch"),
        ("euclidean_loss", "down", "down or sign == 1", "backward must not write its diff"),
        (
            "dropout",
            "top[0].diff * self.factor",
            "top[0].diff * self.factor * (top[0].data != 0)",
            "",
        ),
        ("dropout", "self.active", "self.phase == TRAIN", "sample_weights_test: true is not"),
        ("dropout", DRAW, DRAW.replace("self.rng", "np.random.default_rng(0)"), "the first batch"),
        (
            "phys_limit",
            "bottom[0].data.reshape(-1, len(self.lower))",
            "bottom[0].data",
            "(2, 47, 1)",
        ),
        (
            "joint_transform",
            "p + a * theta[:, motion.dof, None]",
            "p + F[:, :, motion.axis] * theta[:, motion.dof, None]",
            "joints[",
        ),
        ("joint_transform", f"if motion.row >= 0:\n    {WRITTEN}", WRITTEN, "axis["),
        (
            "joint_transform",
            "np.zeros((*np.shape(angle), 3, 3))",
            "np.zeros((len(angle), 3, 3))",
            "len()",
        ),
        (
            "sgd",
            SGD,
            SGD.replace("p.momentum", "0.9 * (p.momentum > 0)"),
            "(momentum 0.5, one rate)",
        ),
        ("resume", "solver.smoothed.clear()", "", "averaged loss[iteration=0]"),
    ],
)
def test_a_solution_that_is_wrong_in_few_cases_is_an_error(
    name: str, old: str, new: str, said: str
) -> None:
    step = last_step(name, edited(EXERCISES[name].source(), old, new))
    assert not step.passed
    assert said in "\n".join(step.lines)
