"""`python -m studies`: the table printed and written, and every bad input refused in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from studies import catalogue
from studies.__main__ import run


def test_a_study_is_printed_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [{"quantity": "step rate", "value": 1.9}]
    monkeypatch.setattr(catalogue, "STUDIES", {"gait": lambda *_: rows})
    assert run(["gait", str(tmp_path / "out"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == rows
    assert json.loads((tmp_path / "out" / "gait.json").read_text()) == rows


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("everything {tmp}/out", "closures, dead-reckoning"),
        ("sensors {tmp}/out --data {tmp}/none", "mall_walks"),
        ("gait {tmp}/text", "text"),
        ("gait {tmp}/text/below", "text"),
        ("elf {tmp}/out --encoder {tmp}/none.onnx", "none.onnx"),
        ("--nonsense", "python -m studies --help"),
    ],
)
def test_bad_arguments_are_refused_in_one_line(
    line: str,
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    known = {**catalogue.STUDIES, "gait": lambda *_: [{"a": 1}]}
    monkeypatch.setattr(catalogue, "STUDIES", known)
    (tmp_path / "text").write_text("some words\n")
    assert run(line.format(tmp=tmp_path).split()) == 2
    seen = capsys.readouterr()
    assert seen.out == ""
    assert len(seen.err.splitlines()) == 1
    assert words in seen.err
    assert [path.name for path in tmp_path.iterdir()] == ["text"]
