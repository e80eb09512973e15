"""Seeded damage to the bytes of a file, as by disks, networks, editors and attackers.

    bytes_, how = damaged(content, donor, random.Random("weights 3 17"), is_text=False)

``how`` describes the damage. Equal ``Random`` states give equal damage.
"""

from __future__ import annotations

import random
import re
import struct
from collections.abc import Callable

Damage = Callable[[bytes, bytes, random.Random], bytes]  # content, another file, random generator

# ---------------------------------------------------------------------------------------------- any file

INTERESTING = (0, 1, 2, 3, 127, 128, 255, 256, 65535, 65536, 10**6, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, -1)


def flip_bits(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Flip one to eight bits anywhere."""
    out = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 8))):
        out[rng.randrange(len(out))] ^= 1 << rng.randrange(8)
    return bytes(out)


def flip_at_the_beginning(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Flip one bit of the first 512 bytes, which contain headers."""
    out = bytearray(content)
    out[rng.randrange(min(len(out), 512))] ^= 1 << rng.randrange(8)
    return bytes(out)


def change_bytes(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Change a few bytes to random values."""
    out = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 16))):
        out[rng.randrange(len(out))] = rng.randrange(256)
    return bytes(out)


def run_of_one_value(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Fill a block with zeros or ones, like a disk that lost it."""
    first, last = _span(content, rng)
    return content[:first] + bytes([rng.choice((0, 255))]) * (last - first) + content[last:]


def truncate(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Remove the end of the file, or nearly all of it."""
    return content[: rng.choice((0, 1, rng.randrange(len(content) + 1), rng.randrange(len(content) + 1), -1))]


def insert(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Insert bytes in the middle or at the end."""
    at = rng.choice((0, len(content), rng.randrange(len(content) + 1)))
    return content[:at] + rng.randbytes(rng.choice((1, 4, 64, 4096))) + content[at:]


def delete(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Remove bytes."""
    first, last = _span(content, rng)
    return content[:first] + content[last:]


def repeat(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Repeat a block once or many times."""
    first, last = _span(content, rng)
    return content[:last] + content[first:last] * rng.choice((1, 1, 2, 20)) + content[last:]


def swap(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Exchange two adjacent blocks."""
    first, last = _span(content, rng)
    middle = rng.randrange(first, last + 1)
    return content[:first] + content[middle:last] + content[first:middle] + content[last:]


def splice(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Join the start of this file and the end of another."""
    return content[: rng.randrange(len(content) + 1)] + donor[rng.randrange(len(donor) + 1) :]


def transplant(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Replace a block by that of another file at the same offset."""
    first, last = _span(content, rng)
    return content[:first] + donor[first:last] + content[last:]


def integer(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Replace an aligned integer, such as a length, an offset or a count, by an extreme value."""
    size = rng.choice((4, 8))
    if len(content) < size:
        return flip_bits(content, donor, rng)
    places = len(content) if rng.random() < 0.5 else min(len(content), 4096)
    at = rng.randrange((places - size) // size + 1) * size
    number = rng.choice(INTERESTING) + rng.choice((0, 0, -1, 1))
    order = rng.choice(("<", "<", "<", ">"))
    return (
        content[:at]
        + struct.pack(f"{order}{'Q' if size == 8 else 'I'}", number % 2 ** (8 * size))
        + content[at + size :]
    )


def nothing_or_noise(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Replace the content by nothing, another file, or random bytes."""
    return rng.choice((b"", donor, rng.randbytes(len(content)), b"\0" * len(content), content[:8] + rng.randbytes(200)))


def _span(content: bytes, rng: random.Random) -> tuple[int, int]:
    first = rng.randrange(len(content))
    return first, min(len(content), first + rng.choice((1, 2, 4, 8, 16, 64, 512, 4096)))


ANY: tuple[Damage, ...] = (
    flip_bits, flip_bits, flip_at_the_beginning, change_bytes, run_of_one_value, truncate, insert, delete, repeat, swap,
    splice, transplant, integer, integer, nothing_or_noise,
)

# ---------------------------------------------------------------------------------------------- text

NUMBERS = (
    "0", "-1", "1", "-0", "3", "1e9", "100000", "2147483647", "2147483648", "-2147483648", "4294967295",
    "9223372036854775807", "9223372036854775808", "18446744073709551615", "18446744073709551616", "nan", "-nan", "inf",
    "-inf", "1e308", "1e309", "-1e400", "1e-320", "0.5", "0x7fffffff", "1_000", "٣", "1e", "--1", "1.2.3",
    "9" * 5000, "-" + "9" * 5000, "0." + "3" * 5000,
)
NAMES = (
    b"", b"a\nb", b"\x1b[2J\x1b[31mred", b"nul\0nul", b"\xff\xfe\x80", b"x" * 5000, b"a" * 300, b"../../x",
    b"/dev/null", b"%s%n%d{0}", b"\xe2\x80\xaeright to left", b"\\", b"'", b'"', b"a/b/c", b".", b"..",
    b"\r", b"\xf0\x9f\x91\x8b",
)
_NUMBER = re.compile(rb"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
_NAME = re.compile(rb'"[^"\n]*"')
_WORD = re.compile(rb"[A-Za-z_][A-Za-z_0-9]*")
_MARK = re.compile(rb"[{}\[\]<>:,;\"']")
_BLOCK = re.compile(rb"[a-z_]+ *\{[^{}]*\}")


def extreme_number(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Replace a number by a very large, a negative or an invalid one."""
    return _replace_one(_NUMBER, content, rng.choice(NUMBERS).encode(), rng)


def several_numbers(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Replace several numbers by extreme ones."""
    for _ in range(rng.randrange(2, 6)):
        content = extreme_number(content, donor, rng)
    return content


def strange_name(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Replace a name by one with a line break, an escape code, a NUL, invalid bytes, or 5,000 letters."""
    name = rng.choice(NAMES)
    if rng.random() < 0.5:
        name = b"".join(b"\\%03o" % byte for byte in name)  # as in the text format
    return (
        _replace_one(_NAME, content, b'"' + name + b'"', rng)
        if _NAME.search(content)
        else _replace_one(_WORD, content, name, rng)
    )


def another_word(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Replace a word by another one of the same file, or remove it."""
    words = _WORD.findall(content) or [b""]
    return _replace_one(_WORD, content, rng.choice([*words, b"", b"true", b"Python"]), rng)


def lost_mark(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Remove or double a brace, quote or colon."""
    marks = list(_MARK.finditer(content))
    if not marks:
        return content.replace(b" ", rng.choice((b"", b"\t", b",")), 1)
    mark = rng.choice(marks)
    return content[: mark.start()] + mark[0] * rng.choice((0, 0, 2, 200)) + content[mark.end() :]


def repeated_block(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Repeat a whole message or a line many times."""
    blocks = list(_BLOCK.finditer(content)) or list(re.finditer(rb"[^\n]+\n", content))
    if not blocks:
        return content * 2
    block = rng.choice(blocks)
    return content[: block.end()] + (b"\n" + block[0]) * rng.choice((1, 2, 100)) + content[block.end() :]


def deep_nesting(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Nest thousands of braces."""
    depth, at = rng.choice((90, 200, 20000)), rng.choice((0, len(content)))
    return content[:at] + b"\na {" * depth + b"}" * rng.choice((0, depth)) + content[at:]


def lines_moved(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Exchange two lines, or remove one."""
    lines = content.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    if rng.random() < 0.3:
        del lines[i]
    else:
        lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def other_encoding(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Convert to the encoding or line breaks of another system."""
    text = content.decode("utf-8", "replace")
    return rng.choice((
        b"\xef\xbb\xbf" + content, content.replace(b"\n", b"\r\n"), content.replace(b"\n", b"\r"),
        text.encode("utf-16"), text.encode("utf-16-le"), text.encode("utf-32"), content + b"\x1a",
        content + b"\0" * 100, content.replace(b"e", "é".encode("latin-1"), 1),
    ))


def long_line(content: bytes, donor: bytes, rng: random.Random) -> bytes:
    """Insert a very long line, or very many short ones."""
    at = rng.randrange(len(content) + 1)
    return (
        content[:at] + rng.choice((b"x", b" 1", b"\n", b'"a" ', b"# ", b"7")) * rng.choice((1000, 30000)) + content[at:]
    )


def _replace_one(pattern: re.Pattern[bytes], content: bytes, new: bytes, rng: random.Random) -> bytes:
    places = list(pattern.finditer(content))
    if not places:
        return content + new
    place = rng.choice(places)
    return content[: place.start()] + new + content[place.end() :]


TEXT: tuple[Damage, ...] = (
    extreme_number, extreme_number, extreme_number, several_numbers, strange_name, strange_name, another_word,
    lost_mark, repeated_block, deep_nesting, lines_moved, other_encoding, long_line,
)


def damaged(content: bytes, donor: bytes, rng: random.Random, is_text: bool) -> tuple[bytes, str]:
    """Apply one to three kinds of damage; returns the new content and the names of the damage."""
    told = []
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        kinds = TEXT if is_text and rng.random() < 0.75 else ANY
        kind = rng.choice(kinds)
        content = kind(content or b"\0", donor or b"\0", rng)
        told.append(kind.__name__)
    return content, " + ".join(told)
