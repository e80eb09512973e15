"""The command ``handpose``: each tool of tools/ as a sub-command with the same options.

handpose train prototxt/nyu_solver.prototxt --max-iter 2000    # in a clone: python tools/train.py ...
handpose export-onnx --help
"""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path
from types import ModuleType

import handpose

PROGRAM = "handpose"
BASE = Path(__file__).resolve().parents[1]
INSTALLED = BASE / "netlib" / "share" / "tools"  # netlib/files/paths.py, which is not imported before a tool starts
TOOLS = INSTALLED if INSTALLED.is_dir() else BASE / "tools"


def main() -> None:
    """Run the tool that the command line names, in this process, as if Python ran its file."""
    words = sys.argv[1:]
    if not words or words[0] in ("-h", "--help"):
        print(usage(), end="")
        sys.exit(0 if words else 2)
    if words[0] == "--version":
        print(f"{PROGRAM} {handpose.__version__}")
        return
    name = words[0].replace("_", "-")
    known = commands()
    if name not in known:
        from netlib.errors import did_you_mean

        print(f"{PROGRAM}: error: unknown command {words[0]!r}{did_you_mean(name, known)}; "
              f"'{PROGRAM} --help' lists them", file=sys.stderr)  # fmt: skip
        sys.exit(2)
    sys.argv = [f"{PROGRAM} {name}", *words[1:]]
    _run(known[name])


def commands() -> dict[str, Path]:
    """The file of each sub-command by its name."""
    return {path.stem.replace("_", "-"): path for path in sorted(TOOLS.glob("*.py")) if path.stem != "__init__"}


def usage() -> str:
    """The commands, each with the first sentence of its docstring."""
    lines = [f"usage: {PROGRAM} COMMAND ...", "", f"'{PROGRAM} COMMAND --help' describes a command.", ""]
    known = commands()
    width = max(map(len, known), default=0)
    for name, path in known.items():
        doc = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        first = " ".join(doc.partition("\n\n")[0].split())
        lines.append(f"  {name:{width}}  {re.split(r'(?<=[.?]) (?=[A-Z])', first, maxsplit=1)[0]}")
    return "\n".join(lines) + "\n"


def _run(path: Path) -> None:
    """Run a file as the main module. ``runpy`` would put the file's name in the place of the command's."""
    sys.path.insert(0, str(path.parent.parent))  # tools/, exercises/ and export/ are not installed as packages
    module = ModuleType("__main__")
    module.__file__ = str(path)
    sys.modules["__main__"] = module
    exec(compile(path.read_bytes(), str(path), "exec"), vars(module))


if __name__ == "__main__":
    main()
