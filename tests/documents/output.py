"""Compare the output shown in a document with the printed one: white space is ignored, numbers have the digits shown.

A number with a decimal point or an exponent agrees if it differs by at most one in the last digit that the document
shows: 0.33 agrees with 0.3312, and 9.3e-07 with 9.27e-07. ``1.``, as NumPy prints a whole float, shows no decimals:
it agrees to 1e-4. Whole numbers and all other text must be equal.
"""

from __future__ import annotations

import re

_EXPONENT = r"(?:[eE][+-]?\d+)?"
_DECIMAL = rf"(?<![\w.])[+-]?(?:\d+\.\d*|\.\d+|\d+(?=[eE][+-]?\d)){_EXPONENT}(?!\.?\d)"
_PARTS = re.compile(rf"(?P<number>{_DECIMAL})|(?P<any>…)|(?P<space>\s+)")
_ANY_NUMBER = rf"([+-]?(?:\d+\.?\d*|\.\d+){_EXPONENT})"
WHOLE = 1e-4  # allowed difference of a float that is shown without decimals


def difference(shown: str, printed: str) -> str:
    """Return the difference of the text shown and printed, or an empty string. ``…`` in the former matches anything."""
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
    """Replace white space by one blank, and remove it inside brackets and before commas, where NumPy pads numbers."""
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
    """Return the value of one unit in the last digit of a number as written."""
    digits, _, exponent = number.lower().partition("e")
    fraction = digits.partition(".")[2]
    if digits.endswith(".") and not exponent:
        return WHOLE
    return float(10.0 ** (int(exponent or 0) - len(fraction)))


def _both(what: str, shown: str, printed: str) -> str:
    def indented(text: str) -> str:
        return "\n".join(f"    {line}" for line in text.rstrip().splitlines()) or "    (nothing)"

    return f"{what}\n  shown:\n{indented(shown)}\n  printed:\n{indented(printed)}"
