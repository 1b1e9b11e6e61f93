"""Ages count time that passed here, and begin anew with every change."""

from __future__ import annotations

from pathlib import Path

import pytest

from elfslam.serve.store.ages import AGES, Age, grown, older_than, read_ages, write_ages


def test_ages_grow_begin_anew_and_go() -> None:
    before = {"same": Age(3, 10.0), "grew": Age(3, 10.0), "gone": Age(1, 10.0)}
    after = grown(before, {"same": 3, "grew": 4, "new": 0}, 5.0)
    assert after == {"same": Age(3, 15.0), "grew": Age(4, 0.0), "new": Age(0, 0.0)}


def test_only_what_is_older_is_found() -> None:
    ages = {"old": Age(1, 86_401.0), "young": Age(1, 86_400.0)}
    assert older_than(ages, 1.0) == ["old"]


def test_ages_are_kept(tmp_path: Path) -> None:
    write_ages(tmp_path, {"upload a": Age(5, 7.5)})
    assert read_ages(tmp_path) == {"upload a": Age(5, 7.5)}


@pytest.mark.parametrize("content", [b"", b"[1]", b'{"a": 3}', b"\xff", b"[" * 100_000])
def test_damaged_ages_begin_anew(tmp_path: Path, content: bytes) -> None:
    (tmp_path / AGES).write_bytes(content)
    assert read_ages(tmp_path) == {}
