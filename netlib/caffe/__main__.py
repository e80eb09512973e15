"""Run a script written for pycaffe unchanged, as Python runs it:

python -m netlib.caffe SCRIPT [ARGUMENT ...]
python -m netlib.caffe - [ARGUMENT ...]           the script on standard input; also without
                                                  -, from a pipe
python -m netlib.caffe -c CODE [ARGUMENT ...]
python -m netlib.caffe -m MODULE [ARGUMENT ...]
"""

from __future__ import annotations

import runpy
import sys
from pathlib import Path
from types import ModuleType

from netlib import install_as_caffe
from netlib.building.python_layer import python_2_advice

OPERANDS = {"-c": "code", "-m": "the name of a module"}


def _run(source: bytes | str, filename: str, **variables: str) -> None:
    """Run a source text as the main module, with these global variables. Bytes may declare
    their encoding.
    """
    sys.modules["__main__"] = module = ModuleType("__main__")
    vars(module).update(variables)
    try:
        code = compile(source, filename, "exec", dont_inherit=True)
        exec(code, vars(module))  # noqa: S102 - the user's own script
    except (ImportError, SyntaxError) as error:
        advice = python_2_advice(error)
        if not advice:
            raise
        sys.exit(f"{error}{advice}")


def main() -> None:
    """Run what the command line names, with netlib.caffe importable as ``caffe``."""
    words = sys.argv[1:]
    if not words and sys.stdin is not None and not sys.stdin.isatty():
        words = ["-"]
    if not words or words[0] in ("-h", "--help"):
        print(__doc__.strip())
        sys.exit(0 if words else 2)
    what, *arguments = words
    if what in OPERANDS and not arguments:
        print(f"{what} needs {OPERANDS[what]}", file=sys.stderr)
        sys.exit(2)
    install_as_caffe()
    sys.path[0] = ""  # the working folder, as for Python's own -, -c and -m
    if what == "-c":
        code, *arguments = arguments
        sys.argv = ["-c", *arguments]
        _run(code, "<string>")
    elif what == "-m":
        sys.argv = arguments
        runpy.run_module(arguments[0], run_name="__main__", alter_sys=True)
    elif what == "-":
        sys.argv = words
        _run(sys.stdin.buffer.read(), "<stdin>")
    else:
        path = Path(what)
        if not path.exists() or path.is_dir():
            sys.exit(f"{what}: script not found")
        sys.argv = words
        sys.path[0] = str(path.resolve().parent)  # as when Python runs the script
        _run(path.read_bytes(), what, __file__=what)


if __name__ == "__main__":
    main()
