"""Seeded damage to the content of a file, as by disks, networks, editors and attackers.

content = damaged(content, content_of_another_file, random.Random("weights 17"), is_text=False)
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable

SIZES = (1, 8, 16, 31, 32, 63, 64)  # bits of integers
INTEGERS = (0, 1, 2, 10**6, *(2**bits - 1 for bits in SIZES), *(2**bits for bits in SIZES[:-1]))
NUMBERS = (
    *b"0 -1 1 3 255 2147483647 2147483648 9999999999999999999 -2147483648".split(),
    *b"1e308 1e-320 nan -inf 0x7fffffff 1_000 1.2.3".split(),
    "\u0663".encode(),
    b"9" * 5000,
    b"",
)
NAMES = (
    b"a\nb",
    b"\x1b[31mred",
    b"nul\0byte",
    b"\xff\xfe",
    b"\xed\xb0\x80",
    b"../../x",
    b"/",
    b"",
    b"x" * 5000,
    b"b/x/0",
    b"data",
    "\u202eright".encode(),
)
NUMBER = re.compile(rb"(?<![\w.])-?\d+\.?\d*(e-?\d+)?")
NAME = re.compile(rb'"[^"\n]*"')
WORD = re.compile(rb"[A-Za-z_]\w*")
MARK = re.compile(rb'[{}":\[\],]')


def damaged(content: bytes, donor: bytes, rng: random.Random, is_text: bool) -> bytes:
    """Apply one to three kinds of damage."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        kinds = TEXT if is_text and rng.random() < 0.75 else ANY
        content = rng.choice(kinds)(content or b"\0", donor or b"\0", rng)
    return content


def flip_bits(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    out = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 8))):
        places = min(len(out), rng.choice((512, len(out))))  # headers are in the first 512 bytes
        out[rng.randrange(places)] ^= 1 << rng.randrange(8)
    return bytes(out)


def extreme_integer(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    size = rng.choice((4, 8))
    places = min(len(content), rng.choice((4096, len(content))))
    at = rng.randrange(places // size + 1) * size
    number = (rng.choice(INTEGERS) + rng.choice((0, 0, -1))) % 256**size
    order = rng.choice(("little", "little", "big"))
    return content[:at] + number.to_bytes(size, order) + content[at + size :]


def truncate(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    anywhere = rng.randrange(len(content))
    return content[: rng.choice((0, 1, anywhere, anywhere, -1))]


def change_range(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Fill, remove, repeat or swap a range, insert random bytes, or splice with another file."""
    first = rng.randrange(len(content))
    last = min(len(content), first + rng.choice((1, 8, 64, 512, 4096)))
    middle = rng.randrange(first, last + 1)
    before = content[:first]
    left = content[first:middle]
    right = content[middle:last]
    after = content[last:]
    if rng.random() < 1 / 8:
        return before + donor[rng.randrange(len(donor)) :]
    size = last - first
    filled = b"\0" * size, b"\xff" * size, rng.randbytes(size) + left + right
    moved = b"", (left + right) * 20, right + left, donor[first:last]
    return before + rng.choice((*filled, *moved)) + after


def extreme_numbers(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    for _ in range(rng.choice((1, 1, 1, 5))):
        content = _replace(NUMBER, content, rng.choice(NUMBERS), rng)
    return content


def odd_name(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    new = rng.choice(NAMES)
    if rng.random() < 0.5:
        new = b"".join(b"\\%03o" % byte for byte in new)
    if NAME.search(content):
        return _replace(NAME, content, b'"' + new + b'"', rng)
    return _replace(WORD, content, new, rng)


def missing_or_repeated_mark(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    mark = rng.choice(MARK.findall(content) or [b" "])
    return _replace(MARK, content, mark * rng.choice((0, 0, 2, 200)), rng)


def deep_nesting(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    depth, at = rng.choice((90, 200, 20000)), rng.choice((0, len(content)))
    opened = rng.choice((b"\na {", b"[")) * depth
    closed = b"}" * rng.choice((0, depth))
    return content[:at] + opened + closed + content[at:]


def other_encoding(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    ends = [content.replace(b"\n", end) for end in (b"\r\n", b"\r")]
    utf_16 = content.decode("utf-8", "replace").encode("utf-16")
    latin_1 = content.replace(b"e", "é".encode("latin-1"), 1)
    marked, padded = b"\xef\xbb\xbf" + content, content + b"\0" * 9
    return rng.choice((*ends, utf_16, latin_1, marked, padded))


def _replace(pattern: re.Pattern[bytes], content: bytes, new: bytes, rng: random.Random) -> bytes:
    """Replace one place that matches, if there is one."""
    found = list(pattern.finditer(content))
    first, last = rng.choice(found).span() if found else (len(content), len(content))
    return content[:first] + new + content[last:]


# content, content of another file, random generator
Damage = Callable[[bytes, bytes, random.Random], bytes]
ANY: tuple[Damage, ...] = (
    flip_bits,
    flip_bits,
    extreme_integer,
    extreme_integer,
    truncate,
    change_range,
    change_range,
)
TEXT: tuple[Damage, ...] = (
    extreme_numbers,
    extreme_numbers,
    odd_name,
    odd_name,
    missing_or_repeated_mark,
    deep_nesting,
    other_encoding,
)
