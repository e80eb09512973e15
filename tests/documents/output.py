"""What a document shows as output, compared with what was printed: white space is free, numbers have the digits shown.

A number with a decimal point or an exponent agrees if it differs by at most one in the last digit that the document
shows: 0.33 is 0.3312, and 9.3e-07 is 9.27e-07. ``1.``, as NumPy writes a float that is whole, has no digit to spare:
it agrees to 1e-4. A whole number, and all else, has to be the same.
"""

from __future__ import annotations

import re

_EXPONENT = r"(?:[eE][+-]?\d+)?"
_DECIMAL = rf"(?<![\w.])[+-]?(?:\d+\.\d*|\.\d+|\d+(?=[eE][+-]?\d)){_EXPONENT}(?!\.?\d)"
_PARTS = re.compile(rf"(?P<number>{_DECIMAL})|(?P<any>…)|(?P<space>\s+)")
_ANY_NUMBER = rf"([+-]?(?:\d+\.?\d*|\.\d+){_EXPONENT})"
WHOLE = 1e-4  # by how much a float that is shown without decimals may differ


def difference(shown: str, printed: str) -> str:
    """Why what was printed is not what is shown; empty if it is. ``…`` in what is shown stands for anything."""
    wanted, found = _normal(shown), _normal(printed)
    if wanted and not wanted.strip("… "):
        return "an output of … alone compares nothing"
    match = re.fullmatch(_pattern(wanted), found, re.DOTALL)
    if match is None:
        return _both("shown and printed differ", shown, printed)
    numbers = [part[0] for part in _PARTS.finditer(wanted) if part["number"]]
    for number, other in zip(numbers, match.groups(), strict=True):
        if abs(float(number) - float(other)) > _unit(number) * (1 + 1e-6):
            return _both(f"{number} is shown, {other} was printed", shown, printed)
    return ""


def _normal(text: str) -> str:
    """White space as one blank, and none inside of brackets and before commas, where NumPy pads numbers."""
    text = " ".join(text.split())
    return re.sub(r" (?=[\]),])", "", re.sub(r"(?<=[\[(]) ", "", text))


def _pattern(wanted: str) -> str:
    pattern, end = "", 0
    for part in _PARTS.finditer(wanted):
        pattern += re.escape(wanted[end : part.start()])
        pattern += _ANY_NUMBER if part["number"] else ".*?" if part["any"] else r"\s+"
        end = part.end()
    return pattern + re.escape(wanted[end:])


def _unit(number: str) -> float:
    """One in the last digit of a number as it is written."""
    digits, _, exponent = number.lower().partition("e")
    fraction = digits.partition(".")[2]
    if digits.endswith(".") and not exponent:
        return WHOLE
    return float(10.0 ** (int(exponent or 0) - len(fraction)))


def _both(what: str, shown: str, printed: str) -> str:
    def indented(text: str) -> str:
        return "\n".join(f"    {line}" for line in text.rstrip().splitlines()) or "    (nothing)"

    return f"{what}\n  shown:\n{indented(shown)}\n  printed:\n{indented(printed)}"
