"""Files of text from outside: read within bounds, and understood as JSON or TOML."""

import json
import math
import os
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from elfslam.base.bounds import MEBIBYTE, MOST_BYTES
from elfslam.base.errors import InputError

MOST_JSON_BYTES, MOST_TOML_BYTES = 16 * MEBIBYTE, 4 * MEBIBYTE
"""What a few bytes of them become in memory takes twenty and ninety times as many."""
MOST_DEPTH = 64
LARGEST_WHOLE = 2**63
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")
_PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?<![\w-])(?:{_PART}[ \t]*+\.[ \t]*+){{{MOST_DEPTH}}}", re.ASCII)
"""A dotted key of many parts: each part costs tomllib as much as all before it together."""


def readable(name: str) -> str:
    """A file's name as text: what the locale could not read is taken as UTF-8, or escaped."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return os.fsencode(name).decode("utf-8", "backslashreplace")
    return name


def read_bytes(file: Path, most_bytes: int = MOST_BYTES) -> bytes:
    """All of an ordinary file.

    Raises InputError where it is missing, cannot be read, is a pipe or a device, or too large.
    """
    try:
        if file.exists() and not file.is_file():
            raise InputError(f"{file}: is no ordinary file; give a copy of what it holds")
        if file.stat().st_size > most_bytes:
            raise InputError(f"{file}: has more than {most_bytes} bytes; cut it in parts")
        return file.read_bytes()
    except OSError as cause:
        raise InputError(
            f"{file}: cannot be read ({cause.strerror or cause}); check the path"
        ) from cause


def read_text(file: Path, most_bytes: int = MOST_BYTES) -> str:
    """The text of a file in UTF-8, with or without a byte order mark. Raises InputError."""
    try:
        return read_bytes(file, most_bytes).decode("utf-8-sig")
    except UnicodeDecodeError as cause:
        raise InputError(f"{file}: is no text in UTF-8 ({cause}); save it as one") from cause


def read_json(file: Path) -> Any:
    """What a JSON file says. Raises InputError as `parse_json`."""
    return parse_json(read_text(file, MOST_JSON_BYTES), str(file))


def read_toml(file: Path) -> dict[str, Any]:
    """What a TOML file says. Raises InputError as `parse_toml`."""
    return parse_toml(read_text(file, MOST_TOML_BYTES), str(file))


def parse_json(text: str, source: str) -> Any:
    """What a JSON text says; its numbers are finite.

    Raises InputError where it is none, is nested too deep, or has numbers or characters that
    nothing can hold.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as cause:
        raise InputError(f"{source}: is no JSON ({_why(cause)}); correct it") from cause
    for leaf in _leaves(content, source):
        if isinstance(leaf, float) and not math.isfinite(leaf):
            raise InputError(f"{source}: holds {leaf}, wanted finite numbers; correct it")
    if _SURROGATE.search(text):
        _refuse_half_characters(content, source)
    return content


def _refuse_half_characters(content: Any, source: str) -> None:
    """JSON can escape half of a surrogate pair, which no file and no terminal can be told."""
    try:
        json.dumps(content, ensure_ascii=False).encode()
    except UnicodeEncodeError as cause:
        half = ascii(cause.object[cause.start])
        raise InputError(f"{source}: holds half a character ({half}); correct it") from cause


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """What a TOML text says. Raises InputError as `parse_json`; here NaN and inf are numbers."""
    if _LONG_KEY.search(text):
        raise InputError(f"{source}: has a key of more than {MOST_DEPTH} parts; make it flat")
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as cause:
        raise InputError(f"{source}: is no TOML ({_why(cause)}); correct it") from cause
    for _ in _leaves(content, source):
        pass
    return content


def _why(cause: ValueError | RecursionError) -> str:
    return "nested too deep" if isinstance(cause, RecursionError) else str(cause)


def _leaves(content: Any, source: str) -> Iterator[Any]:
    """Every value that holds no others. Raises InputError for depth and for whole numbers."""
    levels = [iter((content,))]
    while levels:
        for value in levels[-1]:
            if isinstance(value, dict | list):
                levels.append(iter(value.values() if isinstance(value, dict) else value))
                break
            if isinstance(value, int) and abs(value) > LARGEST_WHOLE:
                raise InputError(f"{source}: holds a whole number beyond 2^63; correct it")
            yield value
        else:
            levels.pop()
        if len(levels) > MOST_DEPTH:
            raise InputError(f"{source}: is nested more than {MOST_DEPTH} deep; make it flat")
