"""Command-line parsing: parsers with the docstring as help, and checked argument types."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable, Container, Sequence
from pathlib import Path
from typing import NoReturn

from netlib import engine
from tools.common.commands import command, is_subcommand

MAX_INTEGER = (1 << 63) - 1  # of integers in files
MAX_COUNT = (1 << 31) - 1
MAX_PORT = 65535
DIGITS = "-?[0-9]{1,1000}"  # of an integer; Python's int() takes quadratic time
MAX_SHOWN = 100  # characters of a value in a message
SWITCHES = ("alsologtostderr", "logtostderr")  # flags of glog that need no value


class _Parser(argparse.ArgumentParser):
    """A parser whose help and errors, for a user of the command handpose or netlib, name commands
    instead of files of a clone.
    """

    def format_help(self) -> str:
        return _with_commands(super().format_help())

    def error(self, message: str) -> NoReturn:
        if re.fullmatch(r"unrecognized arguments:[-+.\d ]+", message):
            message += "; join the numbers of an option by commas: 1,2,3"
        super().error(_with_commands(message))


def _with_commands(text: str) -> str:
    """A text with the names of commands, if this is a command."""
    if not is_subcommand():
        return text
    text = re.sub(
        r"(?:python (?:-m mpi4py )?)?tools/(\w+)\.py", lambda match: command(match[1]), text
    )
    return re.sub(r"\bdocs/(\w+)\.md\b", lambda match: f"'{command('docs')} {match[1]}'", text)


def parser_of(doc: str | None, nets: bool = False) -> argparse.ArgumentParser:
    """Create a parser whose help is the docstring of the tool. ``nets`` adds --no-python-layers.

    That option applies to the whole run inside console.guarded, wherever a net is built.
    """
    parser = _Parser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    if nets:
        parser.add_argument(
            "--no-python-layers",
            action="store_true",
            help="reject nets with layers of type Python, which execute code",
        )
    return parser


def add_engine(parser: argparse.ArgumentParser, threads: bool = False) -> None:
    """Add the option --engine, for tools that run one net, and with ``threads`` the
    option --threads.
    """
    if threads:
        parser.add_argument(
            "--threads",
            type=workers,
            metavar="N",
            help="number of threads (default: one per processor)",
        )
    parser.add_argument(
        "--engine",
        choices=engine.NAMES,
        help="engine that computes the net (default: NETLIB_ENGINE "
        "if set, else fast if the folder fast/ exists)",
    )


def reject_given(
    parser: argparse.ArgumentParser, args: argparse.Namespace, names: Sequence[str], why: str
) -> None:
    """Raise a usage error that ends in ``why`` if one of these options is given, because it
    would be ignored.
    """
    for name in names:
        if getattr(args, name) != parser.get_default(name):
            parser.error(f"--{name.replace('_', '-')} {why}")


def caffes_flags(argv: Sequence[str] | None) -> list[str]:
    """The arguments (None: of the process) with two dashes before flags that have one, as in
    Caffe's programs, and a value for flags of glog that need none.
    """
    words = sys.argv[1:] if argv is None else argv
    words = [f"{word}=true" if word.lstrip("-") in SWITCHES else word for word in words]
    return [
        f"-{word}" if re.fullmatch(r"-[A-Za-z]\w+(=.*)?", word, re.DOTALL) else word
        for word in words
    ]


# ------------------------------------------------------------------------------- types of arguments


def whole(least: int = 0, most: int = MAX_INTEGER) -> Callable[[str], int]:
    """Return a parser of decimal integers from ``least`` to ``most``."""

    def parse(text: str) -> int:
        number = int(text) if re.fullmatch(DIGITS, text) else None
        if number is None or number < least:
            raise expected(f"an integer of at least {least}", text)
        if number > most:
            raise expected(f"an integer of at most {most}", text)
        return number

    return parse


def real(
    least: float = -math.inf, most: float = math.inf, *, above: bool = False, unit: str = ""
) -> Callable[[str], float]:
    """Return a parser of finite numbers from ``least`` to ``most``; ``above``
    excludes ``least``.
    """

    def parse(text: str) -> float:
        found = _finite(text)
        number = found[0] if len(found) == 1 else math.nan  # every comparison with NaN is false
        if not (least < number if above else least <= number) or not number <= most:
            limits = []
            if least > -math.inf:
                limits.append(f"{'greater than' if above else 'of at least'} {least:g}")
            if most < math.inf:
                limits.append(f"{'at most' if limits else 'of at most'} {most:g}")
            form = ["a number", " and ".join(limits), unit]
            raise expected(" ".join(filter(None, form)), text)
        return number

    return parse


def numbers(
    form: str = "numbers separated by commas", counts: Container[int] = range(1, MAX_COUNT)
) -> Callable[[str], tuple[float, ...]]:
    """Return a parser of finite numbers separated by commas: as many as ``counts`` contains, in
    this ``form``.
    """

    def parse(text: str) -> tuple[float, ...]:
        found = _finite(text)
        if len(found) not in counts:
            raise expected(form, text)
        return tuple(found)

    return parse


def address(text: str) -> tuple[str, int]:
    """Parse HOST:PORT, with port 0 for any free one; an IPv6 address is in brackets."""
    host, _, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not re.fullmatch(DIGITS, port) or not 0 <= int(port) <= MAX_PORT:
        raise expected(f"HOST:PORT, a port from 0 to {MAX_PORT}", text)
    return host, int(port)


def name_in(*endings: str) -> Callable[[str], str]:
    """Return a parser of file names with one of these suffixes."""

    def checked(text: str) -> str:
        if Path(text).suffix.lower() not in endings and not (text == "-" and "-" in endings):
            raise expected(f"a file name with suffix {', '.join(endings)}", text)
        return text

    return checked


def pixels(text: str) -> tuple[int, int]:
    """Parse a width and a height in px: 224x224."""
    width, cross, height = text.partition("x")
    if not cross:
        raise expected("WIDTHxHEIGHT in px, such as 224x224", text)
    return side(width), side(height)


natural = whole()
positive = whole(1)
count = whole(1, MAX_COUNT)  # of frames, iterations, passes
workers = whole(1, 1024)  # threads or processes
seed = whole(0, (1 << 32) - 1)  # as of synthetic data
side = whole(1, 1 << 20)  # of images, px
weight = real(0)
seconds = real(0, 1e6, above=True)  # up to 12 days
positive_number = real(0, above=True)


def expected(form: str, text: str) -> argparse.ArgumentTypeError:
    """The error for a value that has not the expected form."""
    found = repr(text) if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]!r}..."
    return argparse.ArgumentTypeError(f"expected {form}, found {found}")


def _finite(text: str) -> list[float]:
    """Numbers separated by commas; empty if the text is anything else, or one of them
    is not finite.
    """
    try:
        found = [float(word) for word in text.split(",")]
    except ValueError:
        return []
    return found if all(map(math.isfinite, found)) else []
