"""Text from outside is read whole or refused in one line, whatever somebody wrote into it."""

import json
import math
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from elfslam.base import text_files
from elfslam.base.errors import InputError

PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**63), 2**63) | st.text() | st.floats(-1e300, 1e300),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=20,
)


def refusal(parse: Callable[[str, str], Any], text: str) -> str:
    with pytest.raises(InputError) as refused:
        parse(text, "notes")
    said = str(refused.value)
    assert said.startswith("notes: ")
    assert "\n" not in said
    assert len(said) < 300
    return said


@given(PLAIN)
def test_json_comes_as_it_was_written(content: object) -> None:
    assert text_files.parse_json(json.dumps(content), "notes") == content


def test_escaped_pairs_are_whole_characters() -> None:
    assert text_files.parse_json(r'"\ud83d\ude00"', "notes") == "\U0001f600"


def test_toml_comes_as_it_was_written() -> None:
    text = 'a = 1\nb = [1.5, {c = "x.y.z"}]\n[d]\ne.f = inf\n'
    wanted = {"a": 1, "b": [1.5, {"c": "x.y.z"}], "d": {"e": {"f": math.inf}}}
    assert text_files.parse_toml(text, "notes") == wanted


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no JSON"),
        ('{"a": ', "no JSON"),
        ("[" * 5000, "no JSON"),
        ("[" * 5000 + "]" * 5000, "nested too deep"),
        ("[" * (text_files.MOST_DEPTH + 1) + "]" * (text_files.MOST_DEPTH + 1), "make it flat"),
        ("1" * 5000, "no JSON"),
        ("9" * 400, "beyond 2"),
        ('{"a": [-9' + "9" * 30 + "]}", "beyond 2"),
        ("[1e400]", "finite"),
        ('{"a": NaN}', "finite"),
        ("-Infinity", "finite"),
        (r'["a\ud800"]', "half a character ('\\ud800')"),
        (r'{"\uDFFF": 1}', "half a character"),
    ],
)
def test_json_that_nothing_can_hold_is_refused(text: str, why: str) -> None:
    assert why in refusal(text_files.parse_json, text)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("a = \nb = 1\n", "line 1"),
        ("a = 1\na = 2\n\n", "line 2"),
        ("a = " + "[" * 5000, "nested too deep"),
        ("a = " + "[" * 70 + "]" * 70, "make it flat"),
        ("a = " + "1" * 5000, "no TOML"),
        ("a = 0x" + "f" * 100_000, "beyond 2"),
        ("a." * 100_000 + "b = 1", "parts"),
        ("[" + '"a" . ' * 100_000 + "b]", "parts"),
        ("x = {" + "'a,'.b." * 50_000 + "c = 1}", "parts"),
    ],
)
def test_toml_that_nothing_can_hold_is_refused(text: str, why: str) -> None:
    assert why in refusal(text_files.parse_toml, text)


@given(st.text())
def test_any_text_is_toml_or_refused(text: str) -> None:
    with suppress(InputError):
        assert isinstance(text_files.parse_toml(text, "notes"), dict)


def test_a_byte_order_mark_is_no_part_of_the_text(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_bytes(b'\xef\xbb\xbf{"a": 1}')
    assert text_files.read_json(file) == {"a": 1}


def test_files_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "latin").write_bytes("größe".encode("latin-1"))
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    for name, why in (
        ("latin", "no text in UTF-8"),
        ("folder", "no ordinary file"),
        ("pipe", "no ordinary file"),
        ("absent", "cannot be read"),
        ("latin/x", "cannot be read"),
    ):
        with pytest.raises(InputError, match=why):
            text_files.read_text(tmp_path / name)


def test_a_file_too_large_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "a"
    file.write_text("a = 10000")
    assert len(text_files.read_bytes(file, 9)) == 9
    with pytest.raises(InputError, match="more than 8 bytes"):
        text_files.read_bytes(file, 8)
    monkeypatch.setattr(text_files, "MOST_TOML_BYTES", 8)
    with pytest.raises(InputError, match="more than 8 bytes"):
        text_files.read_toml(file)
