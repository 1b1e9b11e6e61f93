"""What happens to any file and to texts. Each damage changes a file in place."""

import json
import os
import random
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

Damage = Callable[[Path, random.Random], None]
Change = Callable[[bytes, random.Random], bytes]

NUMBERS = (
    "nan", "inf", "-inf", "1e308", "-1e308", "1e400", "9" * 400, "1e-320", "-0", "-1", "0", "0.5",
    "1e5", "1e9", "1e12", "1e15", "99999999999999999999", "1_000", "0x1F", "\u0661\u0662", "1,5",
)  # fmt: skip
WORDS = (
    "",
    " ",
    "true",
    "null",
    "--",
    "\x00",
    "\ufeff",
    "'",
    '"',
    '"""',
    "a" * 70_000,
    "../..",
    "%s",
)
BYTES = (b"\x00", b"\xff\xfe", b"\r", b"\n\n", b"\x1a", b"NaN", b'"', b"\xf0\x9f", b"9" * 400)


def changed(change: Change) -> Damage:
    def damage(file: Path, chance: random.Random) -> None:
        content = change(file.read_bytes(), chance)
        file.unlink()
        file.write_bytes(content)

    damage.__name__ = change.__name__
    return damage


# Whatever the file is.


def cut_off(content: bytes, chance: random.Random) -> bytes:
    return content[: chance.randrange(len(content) + 1)]


def emptied(content: bytes, chance: random.Random) -> bytes:
    return b""


def flipped(content: bytes, chance: random.Random) -> bytes:
    made = bytearray(content)
    for _ in range(chance.choice((1, 1, 3, 30))):
        if made:
            made[_near_an_end(len(made), chance)] ^= 1 << chance.randrange(8)
    return bytes(made)


def inserted(content: bytes, chance: random.Random) -> bytes:
    at = _near_an_end(len(content) + 1, chance)
    return content[:at] + chance.choice(BYTES) * chance.choice((1, 1, 9)) + content[at:]


def lost(content: bytes, chance: random.Random) -> bytes:
    first = _near_an_end(len(content) + 1, chance)
    return content[:first] + content[first + chance.choice((1, 4, 50, 4096)) :]


def zeroed(content: bytes, chance: random.Random) -> bytes:
    first = _near_an_end(len(content) + 1, chance)
    size = min(chance.choice((4, 512, 4096)), len(content) - first)
    return content[:first] + bytes(size) + content[first + size :]


def twice(content: bytes, chance: random.Random) -> bytes:
    return content + content


def noise(content: bytes, chance: random.Random) -> bytes:
    return chance.randbytes(chance.choice((1, 100, 5000)))


def _near_an_end(size: int, chance: random.Random) -> int:
    """Headers and directories are there."""
    end = min(size, chance.choice((20, 200, size)))
    at = chance.randrange(max(end, 1))
    return at if chance.random() < 0.7 else max(size - 1 - at, 0)


# What lies in the place of the file.


def removed(file: Path, chance: random.Random) -> None:
    file.unlink()


def a_folder(file: Path, chance: random.Random) -> None:
    file.unlink()
    file.mkdir()


def a_pipe(file: Path, chance: random.Random) -> None:
    file.unlink()
    os.mkfifo(file)


def a_link(file: Path, chance: random.Random) -> None:
    file.unlink()
    file.symlink_to(chance.choice((file, "/dev/zero", "/dev/null", "/etc/passwd", "nowhere", ".")))


# Texts, tables first.


def a_cell(content: bytes, chance: random.Random) -> bytes:
    """One number or word is another."""
    cells = list(re.finditer(rb"[^\s,;\t]+", content))
    if not cells:
        return content
    cell = chance.choice(cells[: chance.choice((20, len(cells)))])
    other = chance.choice((*NUMBERS, *WORDS)).encode("utf-8", "surrogatepass")
    return content[: cell.start()] + other + content[cell.end() :]


def a_column(content: bytes, chance: random.Random) -> bytes:
    """A column becomes one number, another column, or goes."""
    rows = [line.split(b",") for line in content.split(b"\n")]
    width = max(map(len, rows))
    one, other = chance.randrange(width), chance.randrange(width)
    kind, number = chance.randrange(4), chance.choice(NUMBERS).encode()
    for k, row in enumerate(rows):
        if len(row) < width or (k == 0 and kind == 0):
            continue
        if kind == 0:
            row[one] = number
        elif kind == 1:
            row[one], row[other] = row[other], row[one]
        elif kind == 2:
            del row[one]
        elif k:
            row[one] = row[one] + chance.choice((b"e3", b"e9", b"e15"))
    return b"\n".join(b",".join(row) for row in rows)


def its_lines(content: bytes, chance: random.Random) -> bytes:
    """Lines change places, come twice, or most of them are lost."""
    lines = content.split(b"\n")
    kind = chance.randrange(5)
    if kind == 0:
        chance.shuffle(lines)
    elif kind == 1:
        lines.insert(chance.randrange(len(lines) + 1), chance.choice(lines))
    elif kind == 2:
        lines = lines[: chance.choice((1, 2, 3, 5))]
    elif kind == 3:
        lines = lines[1:]
    else:
        lines = [lines[0], *lines[:0:-1]]
    return b"\n".join(lines)


def a_long_text(content: bytes, chance: random.Random) -> bytes:
    row = chance.choice((b",", b"\n", b"a,", b"1\n", b'"', b"0,0,0,0\n", b"[", b"a.", b"\t", b";"))
    return content[: chance.choice((0, 40, len(content)))] + row * (20_000_000 // len(row))


JSON: Sequence[Any] = (
    None, True, -1, 0, 1, 1.5, 10**18, 10**400, 1e308, float("nan"), float("inf"), "", "a",
    "a" * 10**5, "\ud800", "\x00", [], {}, [[]], [None], {"": None}, [1, 2], [[1, 2], [3, 4]],
    [0] * 1000,
)  # fmt: skip


def a_value(content: bytes, chance: random.Random) -> bytes:
    """One value of a JSON becomes another."""
    try:
        whole = json.loads(content)
    except ValueError:
        return content
    places: list[tuple[Any, Any]] = []
    left = [whole]
    while left:
        each = left.pop()
        keys = each.keys() if isinstance(each, dict) else range(len(each))
        places += [(each, key) for key in keys]
        left += [each[key] for key in keys if isinstance(each[key], dict | list)]
    if not places or chance.random() < 0.1:
        return json.dumps(chance.choice(JSON)).encode("utf-8", "surrogatepass")
    holder, key = chance.choice(places)
    if chance.random() < 0.2:
        del holder[key]
    else:
        holder[key] = chance.choice(JSON)
    return json.dumps(whole).encode()


def nested(content: bytes, chance: random.Random) -> bytes:
    depth = chance.choice((70, 900, 5000, 200_000))
    return chance.choice(
        (
            b"[" * depth + b"]" * depth,
            b"[" * depth,
            b'{"a":' * depth + b"1" + b"}" * depth,
            b"a = " + b"[" * depth + b"]" * depth,
            b"a." * depth + b"b = 1",
            content + b"\n" + b"{a=" * depth,
        )
    )


TOML = (
    "nan", "inf", "-1", "0", "1", "1e308", "9" * 5000, "0x" + "f" * 5000, "1e5", "1e-9",
    "1000000000", "true", '""', '"a"', '"\\u0000"', "[]", "[[]]", "{}", "[1, 2]",
    "[1, 2, 3]", "[nan, nan]",
    "[[0, 0], [1, 1]]", "[[1e9, 1e9], [2e9, 1e9], [2e9, 2e9]]", "1979-05-27",
    "[0.0, 0.0, 0.0, 0.0]",
    "[" + "1," * 100_000 + "]", "[" + "[1, 1]," * 50_000 + "]",
)  # fmt: skip


def a_setting(content: bytes, chance: random.Random) -> bytes:
    """One value of a TOML becomes another, or its line goes, comes twice or is called otherwise."""
    lines = content.decode(errors="replace").split("\n")
    told = [k for k, line in enumerate(lines) if "=" in line] or [0]
    k = chance.choice(told)
    key, _, value = lines[k].partition("=")
    numbers = list(re.finditer(r"-?\d+\.?\d*", value))
    kind = chance.randrange(7)
    if kind < 2 and numbers:
        number = chance.choice(numbers)
        other = chance.choice(("nan", "-1", "0", "1e-9", "1e9", "1e308", "500", "0.001", "100000"))
        lines[k] = f"{key}={value[: number.start()]}{other}{value[number.end() :]}"
    elif kind < 4:
        lines[k] = f"{key}= {chance.choice(TOML)}"
    elif kind == 4:
        del lines[k]
    elif kind == 5:
        lines.insert(k, lines[k])
    else:
        lines[k] = f"{key.strip()}x = {value}"
    return "\n".join(lines).encode()


ANYTHING = tuple(map(changed, (cut_off, emptied, flipped, inserted, lost, zeroed, twice, noise)))
PLACES: tuple[Damage, ...] = (removed, a_folder, a_pipe, a_link)
