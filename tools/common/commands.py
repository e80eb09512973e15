"""The commands ``handpose`` and ``netlib``: the tools of tools/ as sub-commands with
the same options.

handpose train prototxt/nyu_solver.prototxt --max-iter 2000    # in a clone: python
                                                               tools/train.py ...
netlib run deploy.prototxt net.caffemodel cat.jpg              # in a clone: python
                                                               tools/run_net.py ...

``handpose`` lists every tool in groups, ``netlib`` those for any Caffe net, under short names.
This file imports nothing large, because a tool first prepares its process (tools/__init__.py).
"""

from __future__ import annotations

import ast
import re
import sys
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType

TOOLS = Path(__file__).resolve().parents[1]
IS_CLONE = (TOOLS.parent / "setup.cfg").exists()

# The groups in which ``handpose`` lists its commands.
GROUPS = {
    "Hands in depth images": ("demo", "predict", "track"),
    "Recordings and data": (
        "record",
        "make-recording",
        "make-synthetic",
        "show-data",
        "prepare-nyu",
        "prepare-icvl",
    ),
    "Hand models and scores": ("fit-pose", "evaluate", "score"),
    "Nets": (
        "train",
        "test",
        "finetune",
        "deploy",
        "run-net",
        "test-net",
        "plot-log",
        "time",
        "draw-net",
        "export-onnx",
    ),
    "Caffe's commands": ("caffe", "compute-image-mean", "upgrade-net"),
    "Learning": ("docs", "exercise"),
}

# Commands for nets of any kind, in the order in which a user needs them: short
# name -> file in tools/.
NET_TOOLS = {
    "run": "run_net",
    "deploy": "deploy",
    "finetune": "finetune",
    "train": "train",
    "test": "test_net",
    "time": "time",
    "export-onnx": "export_onnx",
    "draw": "draw_net",
    "upgrade": "upgrade_net",
    "compute-image-mean": "compute_image_mean",
    "plot-log": "plot_log",
    "caffe": "caffe",
    "docs": "docs",
}

# An example for the commands that a new user needs first.
EXAMPLES = {
    "handpose": {
        "demo": "--out demo",
        "predict": "demo/frame_0.png --camera nyu --out pictures",
        "track": '"frames/*.png" --camera sr305 --json hands.json --sheet hands.png',
    },
    "netlib": {
        "run": "deploy.prototxt net.caffemodel cat.jpg --mean 104,117,123 --labels labels.txt",
        "deploy": "train_val.prototxt deploy.prototxt",
        "finetune": "deploy.prototxt net.caffemodel pictures/ --mean 104,117,123 --scale 1",
        "train": "solver.prototxt --weights net.caffemodel",
        "export-onnx": "deploy.prototxt net.caffemodel net.onnx --check",
        "docs": "caffe_nets",
    },
}


# Short name of a file in tools/; ``netlib test`` is tools/test_net.py.
SHORT = {"test": "score"} | {stem: name for name, stem in NET_TOOLS.items()}


def main(program: str) -> None:
    """Run the tool that the command line names, in this process, as if Python ran its file.

    ``program`` is handpose or netlib, which also accepts the names that handpose lists.
    """
    known = commands()
    groups = GROUPS
    if program == "netlib":
        known |= {name: TOOLS / f"{stem}.py" for name, stem in NET_TOOLS.items()}
        groups = {"Commands": tuple(NET_TOOLS)}
    words = sys.argv[1:]
    if not words or words[0] in ("-h", "--help"):
        listed = {title: {name: known[name] for name in names} for title, names in groups.items()}
        print(usage(program, listed), end="")
        sys.exit(0 if words else 2)
    if words[0] == "--version":
        from handpose import __version__

        print(f"{program} {__version__}")
        return
    name = words[0].replace("_", "-")
    if name not in known:
        from netlib.errors import did_you_mean

        print(
            f"{program}: error: unknown command {words[0]!r}{did_you_mean(name, known)}; "
            f"'{program} --help' lists them",
            file=sys.stderr,
        )
        sys.exit(2)
    sys.argv = [f"{program} {name}", *words[1:]]
    _run(known[name])


def command(name: str) -> str:
    """The command line of a tool, in the form in which the user started this one,
    or as installed.
    """
    if not is_subcommand():
        return f"python tools/{name}.py" if IS_CLONE else f"handpose {name.replace('_', '-')}"
    program = sys.argv[0].split()[0]
    word = SHORT.get(name, name) if program == "netlib" else name
    return f"{program} {word.replace('_', '-')}"


def is_subcommand() -> bool:
    """Whether this process was started as ``handpose NAME`` or ``netlib NAME``."""
    return sys.argv[0].startswith(("handpose ", "netlib "))  # as main sets it


def commands() -> dict[str, Path]:
    """The file of each sub-command of ``handpose`` by its name."""
    files = {
        path.stem.replace("_", "-"): path
        for path in sorted(TOOLS.glob("*.py"))
        if path.stem != "__init__"
    }
    return files | {"score": files["test"]}  # `netlib test` is another program: of any net


def usage(program: str, groups: dict[str, dict[str, Path]]) -> str:
    """The commands by group, each with the first sentence of its docstring."""
    lines = [
        f"usage: {program} COMMAND ...",
        "",
        f"'{program} COMMAND --help' describes a command, "
        f"'{program} docs' lists the pages of the documentation.",
    ]
    width = max(len(name) for listed in groups.values() for name in listed)
    for title, listed in groups.items():
        lines += ["", f"{title}:"]
        for name, path in listed.items():
            lines.append(f"  {name:{width}}  {summary_of(path)}")
            if name in EXAMPLES[program]:
                lines.append(f"  {'':{width}}    {program} {name} {EXAMPLES[program][name]}")
    return "\n".join(lines) + "\n"


def summary_of(path: Path) -> str:
    """The first sentence of a file's docstring, or its first paragraph."""
    doc = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return re.split(r"(?<=[.?]) (?=[A-Z])", " ".join(doc.partition("\n\n")[0].split()), maxsplit=1)[
        0
    ]


def _run(path: Path) -> None:
    """Run a file as the main module.

    ``runpy`` would put the file's name in the place of the command's.
    """
    module = ModuleType("__main__")
    module.__file__ = str(path)
    sys.modules["__main__"] = module
    SourceFileLoader("__main__", str(path)).exec_module(module)
