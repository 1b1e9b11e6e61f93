"""Tables, exit codes and silence in a pipe."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

import pytest

from elfslam.app.console import exit_code_of, fitting_columns, print_rows, progress_bar
from elfslam.base.errors import InputError, NoAnswerError

ROWS = [{"name": "a", "x_m": 0.123456, "n": None}, {"name": "b", "x_m": 12345.678, "n": {"OK": 3}}]


def test_a_table_shows_every_cell(capsys: pytest.CaptureFixture[str]) -> None:
    print_rows(ROWS, title="Things", as_json=False)
    out = capsys.readouterr().out
    for text in ("Things", "x_m", "0.12", "1.23e+04", "-", "OK 3"):
        assert text in out


def test_json_keeps_full_precision(capsys: pytest.CaptureFixture[str]) -> None:
    print_rows(ROWS, title="Things", as_json=True)
    assert json.loads(capsys.readouterr().out) == ROWS


def fail(error: Exception) -> int:
    raise error


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (InputError("bad"), 2),
        (NoAnswerError("nothing found"), 1),
        (PermissionError(13, "Permission denied", "map.npz"), 2),
        (OSError("Timeout"), 2),
        (MemoryError(), 2),
        (MemoryError("Unable to allocate 7 TiB"), 2),
        (ModuleNotFoundError("No module named 'torch.nn'", name="torch.nn"), 2),
    ],
)
def test_errors_become_one_line(
    error: Exception, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code_of(lambda: fail(error)) == code
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_what_is_missing_is_named_with_its_extra(capsys: pytest.CaptureFixture[str]) -> None:
    exit_code_of(lambda: fail(ModuleNotFoundError("gone", name="torch")))
    assert capsys.readouterr().err == (
        "elfslam: this needs torch, which is not installed; run pip install 'elfslam[learn]'\n"
    )


@pytest.mark.parametrize(
    "error", [KeyError("bug"), ModuleNotFoundError("gone", name="elfslam.nowhere"), ImportError()]
)
def test_a_programming_error_is_not_hidden(error: Exception) -> None:
    with pytest.raises(type(error)):
        exit_code_of(lambda: fail(error))


CONSOLE = (
    "from elfslam.app.console import exit_code_of, say; import sys; sys.exit(exit_code_of(do))"
)


def end_of(do: str, **where: Any) -> subprocess.CompletedProcess[str]:
    """How a process ends that does this as its command."""
    command = [sys.executable, "-c", f"def do():\n    {do}\n    return 0\n{CONSOLE}"]
    return subprocess.run(command, stderr=subprocess.PIPE, text=True, check=False, **where)


def test_a_closed_pipe_ends_it_in_silence() -> None:
    read, write = os.pipe()
    os.close(read)
    ended = end_of("print('x' * 10)", stdout=write)
    os.close(write)
    assert (ended.returncode, ended.stderr) == (1, "")


def test_output_that_cannot_be_written_is_an_error_in_one_line() -> None:
    with open("/dev/full", "w") as full:
        ended = end_of("print('x' * 10)", stdout=full)
    assert ended.returncode == 2
    assert ended.stderr.count("\n") == 1
    assert "No space left on device" in ended.stderr


def test_nobody_who_listens_is_no_error() -> None:
    """Neither a closed standard error nor a full one changes how a command ends."""
    script = f"{sys.executable} -c \"def do():\n    say('hear')\n    return 0\n{CONSOLE}\""
    for nowhere in ("2>&-", "2>/dev/full"):
        assert subprocess.run(["sh", "-c", f"{script} {nowhere}"], check=False).returncode == 0


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
