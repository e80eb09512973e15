"""What documents take from the code.

``make docs`` has cog call these functions, which print Markdown.

In a document, the result stands between two comments:

    <!--cog code("layers/hand/kinematics.py", "rotation") cog-->
    <!--end-->
"""

from __future__ import annotations

import ast
import textwrap

from exercises.check import steps
from exercises.table import EXERCISES
from handpose.body.joint_formats.formats import FORMATS, FormatName
from handpose.body.joint_formats.frames import LONG_FINGERS, POINTS, Point
from netlib.files.paths import ROOT

FORMAT_TITLES: dict[FormatName, str] = {"mediapipe": "MediaPipe", "mano": "MANO"}


def code(name: str, *names: str) -> None:
    """A file as a block of code, or some functions, classes, methods and constants of it,
    without indentation.

    The name ``docstring`` is the module's. Raises ValueError for a name that the file
    does not define.
    """
    path = ROOT / name
    text = path.read_text(encoding="utf-8")
    pieces = [_source(text, one, name) for one in names] or [text.rstrip("\n")]
    language = "python" if path.suffix == ".py" else path.suffix[1:]
    print(f"```{language}", "\n\n".join(pieces), "```", sep="\n")


def _source(text: str, wanted: str, name: str) -> str:
    """The source of a function, class, method or constant; ``name`` is that of the file."""
    tree = ast.parse(text)
    if wanted == "docstring":
        return f'"""{ast.get_docstring(tree, clean=False)}"""'
    statements, found = tree.body, None
    for part in wanted.split("."):
        found = next((statement for statement in statements if part in _defined(statement)), None)
        if found is None:
            raise ValueError(f"{name} does not define {wanted}")
        statements = found.body if isinstance(found, ast.ClassDef) else []
    assert found is not None
    decorators = getattr(found, "decorator_list", ())
    first = min(node.lineno for node in (found, *decorators))
    return textwrap.dedent("\n".join(text.splitlines()[first - 1 : found.end_lineno]))


def _defined(statement: ast.stmt) -> list[str]:
    """The names that a statement defines."""
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return [statement.name]
    targets = (
        statement.targets
        if isinstance(statement, ast.Assign)
        else [getattr(statement, "target", None)]
    )
    return [target.id for target in targets if isinstance(target, ast.Name)]


def exercises() -> None:
    """A table of the exercises, in the order of the book."""
    print("| | exercise | to implement | chapter |\n|---|---|---|---|")
    for number, exercise in enumerate(EXERCISES.values(), 1):
        names = ", ".join(f"`{name.rpartition('.')[2]}`" for name in exercise.to_do)
        (chapter,) = (ROOT / "docs" / "book").glob(f"{exercise.chapter}_*.md")
        title = chapter.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")
        link = f"[{title}](../book/{chapter.name})"
        print(f"| {number} | {exercise.name} | {exercise.title} ({names}) | {link} |")


def failed_exercise() -> None:
    """The report on a ReLU whose gradient at 0 is 1, its third known mistake."""
    exercise = EXERCISES["relu"]
    [part] = exercise.mistakes[2].parts(exercise)
    print("```text", *(step.report() for step in steps(exercise, part)), "```", sep="\n")


def joint_formats() -> None:
    """A table of the points of wrist, thumb and index finger: how each is computed, and the joints
    of other formats.
    """
    rows = [["computed as", *FORMAT_TITLES.values(), "against the anatomical point"]]
    rows.append(["---"] * len(rows[0]))
    for part, point in POINTS.items():
        joints = [_joints_at(point, key) for key in FORMAT_TITLES]
        if any(joints) and not part.startswith(LONG_FINGERS[1:]):
            rows.append([_sum_of(point), *joints, point.bias])
    for row in rows:
        print(f"| {' | '.join(row)} |")


def _joints_at(point: Point, key: FormatName) -> str:
    """The joints of a format that are this point."""
    joints = enumerate(FORMATS[key].joints.items())
    return ", ".join(f"`{number} {name}`" for number, (name, place) in joints if place is point)


def _sum_of(point: Point) -> str:
    """The weighted sum of joints that a point is."""
    terms = []
    for joint, weight in point.weights.items():
        factor = "" if weight == 1 else f"{weight:.3g} "
        terms.append(f"{factor}`{joint}`")
    return " + ".join(terms).replace("+ -", "− ")
