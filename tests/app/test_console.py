"""Tables, exit codes and silence in a pipe."""

import io
import logging
import os
import subprocess
import sys
from typing import Any

import numba
import pytest
from rich.console import Console

from elfslam.app import console
from elfslam.base.errors import InputError, NoAnswerError

ROWS = [{"name": "a", "x_m": 0.123456, "n": None}, {"name": "b", "x_m": 12345.678, "n": {"OK": 3}}]


def test_a_table_shows_every_cell(capsys: pytest.CaptureFixture[str]) -> None:
    console.print_rows(ROWS, title="Things", as_json=False)
    out = capsys.readouterr().out
    for text in ("Things", "x_m", "0.12", "1.23e+04", "-", "OK 3"):
        assert text in out


HOSTILE = "\x1b]0;owned\x07\x1b[2J\x9b1m\x7f\u202ecod.exe\u2066\u2028\ud800\r\n[red]:smile:[/]"
SHOWN = r"\x1b]0;owned\x07\x1b[2J\x9b1m\x7f\u202ecod.exe\u2066\u2028\ud800\r\n[red]:smile:[/]"


def test_what_a_name_holds_is_printed_and_not_obeyed(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [{HOSTILE: HOSTILE, "in": {HOSTILE: 1}}]
    console.print_rows(rows, title=HOSTILE, as_json=False)
    console.print_line(HOSTILE)
    table = capsys.readouterr().out
    console.say(f"elfslam: {HOSTILE}: no")
    said = capsys.readouterr().err
    assert {each for each in table + said if not each.isprintable()} == {"\n"}
    assert "".join(table.replace(" ", "").split("\n")).count("[red]:smile:[/]") >= 4
    assert table.splitlines()[-1] == SHOWN
    assert said == f"elfslam: {SHOWN.replace(chr(92) + 'n', ' ')}: no\n"


def test_letters_of_every_script_stay(capsys: pytest.CaptureFixture[str]) -> None:
    names = "Zoë אבג 漢字 हिन्दी 👩\u200d🔬"
    console.print_line(names)
    assert capsys.readouterr().out == f"{names}\n"


def test_a_progress_bar_says_no_more_than_text(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a terminal, where the control characters are those of the bar alone."""
    drawn = io.StringIO()
    terminal = Console(file=drawn, force_terminal=True, width=100, markup=False, emoji=False)
    monkeypatch.setattr(console, "_console", lambda **_: terminal)
    with console.progress_bar() as announce:
        announce("\x1b]0;owned\x07[red]walk[/]", 0.5)
    assert r"\x1b]0;owned\x07[red]walk[/]" in drawn.getvalue()
    assert "\x1b]0" not in drawn.getvalue()


def test_what_is_logged_is_a_line_and_a_traceback_keeps_its_lines() -> None:
    shown = io.StringIO()
    handler = logging.StreamHandler(shown)
    handler.setFormatter(console.PrintableFormatter())
    logger = logging.Logger("of others")
    logger.addHandler(handler)
    logger.warning("job %s failed", "a\x1b[2J\nERROR: forged")
    try:
        raise ValueError("\x1b[2J")
    except ValueError:
        logger.exception("failed")
    lines = shown.getvalue().splitlines()
    assert lines[0] == r"job a\x1b[2J ERROR: forged failed"
    assert lines[1] == "failed"
    assert lines[-1] == r"ValueError: \x1b[2J"
    assert len(lines) > 4


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
def test_errors_are_a_line(error: Exception, code: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert console.exit_code_of(lambda: fail(error)) == code
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_what_is_missing_is_named_with_its_extra(capsys: pytest.CaptureFixture[str]) -> None:
    console.exit_code_of(lambda: fail(ModuleNotFoundError("gone", name="torch")))
    assert capsys.readouterr().err == (
        "elfslam: this needs torch, which is not installed; run make studies in the checkout\n"
    )


@pytest.mark.parametrize(
    "error", [KeyError("bug"), ModuleNotFoundError("gone", name="elfslam.nowhere"), ImportError()]
)
def test_a_programming_error_is_not_hidden(error: Exception) -> None:
    with pytest.raises(type(error)):
        console.exit_code_of(lambda: fail(error))


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
    with console.progress_bar() as announce:
        announce("working", 0.5)
        announce("working", None)
    assert capsys.readouterr() == ("", "")


def test_a_table_keeps_columns_that_fit_and_names_more(capsys: pytest.CaptureFixture[str]) -> None:
    row = {"name": "a walk", **{f"column {k} of many": f"value {k}" for k in range(20)}}
    console.print_rows([row], title="Wide", as_json=False)
    lines = capsys.readouterr().out.splitlines()
    assert max(len(line) for line in lines) <= 120
    text = "\n".join(lines)
    assert all(f"value {k}" in text for k in range(5))
    assert "value 19" not in text
    shown = [k for k in range(20) if f"value {k} " in text or f"value {k}\n" in text]
    assert shown == list(range(len(shown)))
    assert "column 19 of many; --json has all columns" in " ".join(line.strip() for line in lines)


def test_the_first_use_is_told_and_later_ones_are_not() -> None:
    twice = numba.njit(lambda value: 2 * value)
    told: list[tuple[str, float | None]] = []
    with console.compilation_announced(lambda *said: told.append(said)):
        assert twice(3) == 6
        first = len(told)
        assert twice(4) == 8
    assert (first, len(told)) == (1, 1)
    assert "compiling" in told[0][0]
    assert twice(0.5) == 1.0
    assert len(told) == 1, "nobody listens any more"
