"""Command-line parsing: parsers with the docstring as help, and checked argument types."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from netlib import engine
from netlib.files.paths import command, is_subcommand

MAX_INTEGER = (1 << 63) - 1  # of integers in files
MAX_COUNT = (1 << 31) - 1
MAX_WORKERS = 1024
MAX_SIDE = 1 << 20  # px
MAX_SECONDS = 1e6  # 12 days
MAX_SEED = (1 << 32) - 1  # as of synthetic data
MAX_PORT = 65535
MAX_DIGITS = 1000  # Python's int() takes quadratic time
MAX_SHOWN = 100  # characters of a value in a message


class _Parser(argparse.ArgumentParser):
    """A parser whose help, for a user of the command handpose or netlib, names commands instead of files of a clone."""

    def format_help(self) -> str:
        text = super().format_help()
        if not is_subcommand():
            return text
        text = re.sub(r"(?:python (?:-m mpi4py )?)?tools/(\w+)\.py", lambda match: command(match[1]), text)
        return re.sub(r"\bdocs/(\w+)\.md\b", lambda match: f"'{command('docs')} {match[1]}'", text)


def parser_of(doc: str | None, nets: bool = False) -> argparse.ArgumentParser:
    """Create a parser whose help is the docstring of the tool. ``nets`` adds --no-python-layers.

    That option applies to the whole run inside console.guarded, wherever a net is built.
    """
    parser = _Parser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    if nets:
        parser.add_argument("--no-python-layers", action="store_true",
                            help="reject nets with layers of type Python, which execute code")
    return parser


def reject_given(parser: argparse.ArgumentParser, args: argparse.Namespace, names: Sequence[str], why: str) -> None:
    """Raise a usage error that ends in ``why`` if one of these options is given, because it would be ignored."""
    for name in names:
        if getattr(args, name) != parser.get_default(name):
            parser.error(f"--{name.replace('_', '-')} {why}")


def add_engine(parser: argparse.ArgumentParser) -> None:
    """Add the option --engine, for tools that run one net."""
    parser.add_argument(
        "--engine",
        choices=engine.NAMES,
        help="engine that computes the net (default: NETLIB_ENGINE if set, else fast if the folder fast/ exists)",
    )


def caffes_flags(argv: Sequence[str] | None, switches: Sequence[str] = ()) -> list[str]:
    """Convert a command line in the style of Caffe's programs for argparse; ``argv`` None is that of the program.

    A flag has one dash or two; its value follows it or an equals sign. Switches can be written ``-gray=true`` or
    ``-nogray``.
    """
    result = []
    for word in sys.argv[1:] if argv is None else argv:
        flag = re.fullmatch(r"--?([A-Za-z]\w+)(=.*)?", word, re.DOTALL)
        if flag is None:
            result.append(word)
        elif flag[1] in switches and flag[2] in ("=true", "=t", "=1", "=yes", "=y"):
            result.append(f"--{flag[1]}")
        elif flag[1] in switches and flag[2] in ("=false", "=f", "=0", "=no", "=n"):
            continue
        elif not (flag[1].removeprefix("no") in switches and flag[1] not in switches and flag[2] is None):
            result.append(f"--{flag[1]}{flag[2] or ''}")
    return result


def whole(least: int = 0, most: int = MAX_INTEGER) -> Callable[[str], int]:
    """Return a parser of decimal integers from ``least`` to ``most``."""

    def parse(text: str) -> int:
        digits = text.removeprefix("-")
        if not (digits.isascii() and digits.isdigit() and len(digits) < MAX_DIGITS) or int(text) < least:
            raise argparse.ArgumentTypeError(f"expected an integer of at least {least}, found {_cut(text)}")
        if int(text) > most:
            raise argparse.ArgumentTypeError(f"expected an integer of at most {most}, found {_cut(text)}")
        return int(text)

    return parse


def real(least: float = -math.inf, most: float = math.inf, *, above: bool = False) -> Callable[[str], float]:
    """Return a parser of finite numbers from ``least`` to ``most``; ``above`` excludes ``least``."""

    def parse(text: str) -> float:
        number = finite(text)
        if not (least < number if above else least <= number) or not number <= most:
            lower = f" {'greater than' if above else 'of at least'} {least:g}" if least > -math.inf else ""
            upper = f"{' and' if lower else ' of'} at most {most:g}" if most < math.inf else ""
            raise argparse.ArgumentTypeError(f"expected a number{lower}{upper}, found {_cut(text)}")
        return number

    return parse


natural = whole()
positive = whole(1)
count = whole(1, MAX_COUNT)  # of frames, iterations, passes
workers = whole(1, MAX_WORKERS)  # threads or processes
seed = whole(0, MAX_SEED)
weight = real(0)
seconds = real(0, MAX_SECONDS, above=True)
positive_number = real(0, above=True)


def address(least: int = 1) -> Callable[[str], tuple[str, int]]:
    """Return a parser of HOST:PORT, with a port from ``least`` on; an IPv6 address is in brackets."""
    parse_port = whole(least, MAX_PORT)

    def parse(text: str) -> tuple[str, int]:
        host, _, port = text.rpartition(":")
        host = host.removeprefix("[").removesuffix("]")
        try:
            if not host or port != port.strip():
                raise argparse.ArgumentTypeError
            return host, parse_port(port)
        except argparse.ArgumentTypeError:
            raise argparse.ArgumentTypeError(f"expected HOST:PORT, a port from {least} to {MAX_PORT}, found "
                                             f"{_cut(text)}") from None

    return parse


def named_file(text: str) -> tuple[str, str]:
    """Split NAME=FILE."""
    name, _, path = text.partition("=")
    if not name.strip() or not path:
        raise argparse.ArgumentTypeError(f"expected NAME=FILE, found {text!r}")
    return name.strip(), path


def with_dash(argv: Sequence[str] | None, option: str, suffix: str) -> list[str]:
    """Return the arguments (None: of the process) with ``-`` as value of an option that no file name follows."""
    given = list(sys.argv[1:] if argv is None else argv)
    for i, (word, following) in enumerate(zip(given, [*given[1:], ""])):
        if word == option and following != "-" and Path(following).suffix.lower() != suffix:
            given[i] = f"{option}=-"
    return given


def name_in(*endings: str) -> Callable[[str], str]:
    """Return a parser of file names with one of these suffixes."""

    def checked(text: str) -> str:
        if Path(text).suffix.lower() not in endings and not (text == "-" and "-" in endings):
            raise argparse.ArgumentTypeError(f"expected a file name with suffix {', '.join(endings)}, found {text!r}")
        return text

    return checked


def numbers(text: str) -> tuple[float, ...]:
    """Parse finite numbers separated by commas: 104,117,123."""
    if not (found := finite_values(text)):
        raise argparse.ArgumentTypeError(f"expected numbers separated by commas, found {_cut(text)}")
    return found


def pixels(text: str) -> tuple[int, int]:
    """Parse a width and a height in px: 224x224."""
    side = whole(1, MAX_SIDE)
    width, cross, height = text.partition("x")
    if not cross:
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT in px, such as 224x224, found {_cut(text)}")
    return side(width), side(height)


def finite(text: str) -> float:
    """Parse a finite number; NaN, for which every comparison fails, if the text is not one."""
    numbers = finite_values(text)
    return numbers[0] if len(numbers) == 1 else math.nan


def finite_values(text: str) -> tuple[float, ...]:
    """Parse finite numbers separated by commas; empty if the text is anything else."""
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        return ()
    return numbers if all(map(math.isfinite, numbers)) else ()


def _cut(text: str) -> str:
    """A value in quotes, for messages."""
    return repr(text) if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]!r}..."
