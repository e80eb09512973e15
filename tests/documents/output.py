"""Compare the output shown in a document with the printed one: white space is ignored, numbers have the digits shown.

Doctest's NUMBER cannot do it: it accepts ``[1., 0.]`` for ``[0., 1.]``, and no wildcard next to numbers. Here a number
with a decimal point or an exponent may differ by one in the last digit shown; ``1.``, as NumPy prints a whole float,
agrees to 1e-4. Whole numbers and all other text must be equal; ``…`` in the document matches anything.
"""

from __future__ import annotations

import re

_EXPONENT = r"(?:[eE][+-]?\d+)?"
_DECIMAL = rf"(?<![\w.])[+-]?(?:\d+\.\d*|\.\d+|\d+(?=[eE][+-]?\d)){_EXPONENT}(?!\.?\d)"
_PARTS = re.compile(rf"(?P<number>{_DECIMAL})|(?P<any>…)|(?P<space>\s+)")
_ANY_NUMBER = rf"([+-]?(?:\d+\.?\d*|\.\d+){_EXPONENT})"


def difference(shown: str, printed: str) -> str:
    """The difference of the text shown and printed, or an empty string."""
    wanted, found = _normal(shown), _normal(printed)
    match = re.fullmatch(_pattern(wanted), found, re.DOTALL)
    if match is None or (wanted and not wanted.strip("… ")):
        return f"shown and printed differ\n  shown:\n{shown}\n  printed:\n{printed}"
    numbers = (part[0] for part in _PARTS.finditer(wanted) if part["number"])
    for number, other in zip(numbers, match.groups(), strict=True):
        if abs(float(number) - float(other)) > _unit(number) * (1 + 1e-6):
            return f"{number} is shown, {other} was printed\n  shown:\n{shown}\n  printed:\n{printed}"
    return ""


def _normal(text: str) -> str:
    """White space is one blank, and none inside brackets and before commas, where NumPy pads numbers."""
    return re.sub(r" (?=[\]),])", "", re.sub(r"(?<=[\[(]) ", "", " ".join(text.split())))


def _pattern(wanted: str) -> str:
    pattern, end = "", 0
    for part in _PARTS.finditer(wanted):
        pattern += re.escape(wanted[end : part.start()])
        pattern += _ANY_NUMBER if part["number"] else ".*?" if part["any"] else r"\s+"
        end = part.end()
    return pattern + re.escape(wanted[end:])


def _unit(number: str) -> float:
    """One unit in the last digit of a number as written."""
    digits, _, exponent = number.lower().partition("e")
    if digits.endswith(".") and not exponent:
        return 1e-4
    return float(10.0 ** (int(exponent or 0) - len(digits.partition(".")[2])))
