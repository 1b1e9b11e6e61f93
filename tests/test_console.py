"""Tables, exit codes and silence in a pipe."""

from __future__ import annotations

import json

import pytest

from elfslam.base.errors import InputError, NoAnswerError
from elfslam.console import exit_code_of, fitting_columns, print_rows, progress_bar

ROWS = [{"name": "a", "x_m": 0.123456, "n": None}, {"name": "b", "x_m": 12345.678, "n": {"OK": 3}}]


def test_a_table_shows_every_cell(capsys: pytest.CaptureFixture[str]) -> None:
    print_rows(ROWS, title="Things", as_json=False)
    out = capsys.readouterr().out
    for text in ("Things", "x_m", "0.12", "1.23e+04", "-", "OK 3"):
        assert text in out


def test_json_keeps_full_precision(capsys: pytest.CaptureFixture[str]) -> None:
    print_rows(ROWS, title="Things", as_json=True)
    assert json.loads(capsys.readouterr().out) == ROWS


def fail(error: Exception) -> None:
    raise error


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (InputError("bad"), 2),
        (NoAnswerError("nothing found"), 1),
        (PermissionError(13, "Permission denied", "map.npz"), 2),
    ],
)
def test_errors_become_one_line(
    error: Exception, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code_of(lambda: fail(error)) == code
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_a_programming_error_is_not_hidden() -> None:
    with pytest.raises(KeyError):
        exit_code_of(lambda: fail(KeyError("bug")))


def test_progress_is_silent_in_a_pipe(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar() as announce:
        announce("working", 0.5)
        announce("working", None)
    assert capsys.readouterr() == ("", "")


def test_a_table_keeps_the_columns_that_fit_and_names_the_others(
    capsys: pytest.CaptureFixture[str],
) -> None:
    row = {"name": "a walk", **{f"column {k} of many": f"value {k}" for k in range(20)}}
    print_rows([row], title="Wide", as_json=False)
    lines = capsys.readouterr().out.splitlines()
    assert max(len(line) for line in lines) <= 120
    text = "\n".join(lines)
    assert all(f"value {k}" in text for k in range(5))
    assert "value 19" not in text
    shown = [k for k in range(20) if f"value {k} " in text or f"value {k}\n" in text]
    assert shown == list(range(len(shown)))
    assert "column 19 of many; --json has all columns" in " ".join(line.strip() for line in lines)


def test_every_column_stays_where_the_table_fits_to_the_last_character() -> None:
    rows = [{"one": "x" * 10, "two": "y" * 10}]
    assert fitting_columns(rows, 27) == ["one", "two"]
    assert fitting_columns(rows, 26) == ["one"]
    assert fitting_columns(rows, 3) == ["one"]
    assert fitting_columns([], 80) == []


def test_no_cell_is_cut_where_a_table_fits_just_so(capsys: pytest.CaptureFixture[str]) -> None:
    row = {"a": "x" * 30, "b": "y" * 30, "c": "z" * 30, "d": "w" * 17}
    assert fitting_columns([row], 120) == ["a", "b", "c", "d"]
    print_rows([row], title="Just so", as_json=False)
    out = capsys.readouterr().out
    assert all(text in out for text in row.values())
