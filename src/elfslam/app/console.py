"""What a person sees on a terminal: progress, tables, and errors as one line."""

from __future__ import annotations

import json
import logging
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import accumulate
from typing import TYPE_CHECKING, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from elfslam.base.errors import ElfslamError, NoAnswerError, ParameterError
from elfslam.base.extras import extra_with, installing

if TYPE_CHECKING:
    from elfslam.base.values import Announce

DONE, NO_ANSWER, BAD_INPUT, CLOSED_PIPE, INTERRUPTED = 0, 1, 2, 1, 130
EXPLAINED = (ElfslamError, OSError, MemoryError, ModuleNotFoundError, UnicodeEncodeError)
"""What a user can act on: a bug is none of them."""

COMPILED = "numba:compile"
"""What numba calls it when a function is compiled; one that it kept on disk is not."""
PIPE_WIDTH = 120
GAP = 3
"""Between two columns of a table."""
FOLDED = 32
"""Longer texts take several lines."""
UNPRINTABLE = re.compile(
    r"[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""Control characters, ends of lines, what turns the direction of writing, and half characters."""


def printable(text: str) -> str:
    """The text with escapes for all that does more to a terminal than to appear there.

    Names come from files and file names of others, which may hold anything.
    """
    return UNPRINTABLE.sub(lambda found: ascii(found[0])[1:-1], text)


class PrintableFormatter(logging.Formatter):
    """A line for each message, whatever it holds; tracebacks keep their lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802
        return _one_line(super().formatMessage(record))

    def formatException(self, ei: Any) -> str:  # noqa: N802
        return "\n".join(map(printable, super().formatException(ei).split("\n")))


def say_what_is_logged() -> None:
    """Have logs, warnings and bugs come to standard error in characters that do no harm."""
    handler = logging.StreamHandler()
    handler.setFormatter(PrintableFormatter())
    logging.basicConfig(handlers=[handler])
    logging.captureWarnings(True)
    sys.excepthook = lambda *error: logging.critical("a bug ended this", exc_info=error)


@contextmanager
def progress_bar() -> Iterator[Announce]:
    """A progress bar on a terminal, silence in a pipe."""
    console = _console(stderr=True)
    described = TextColumn("{task.description:<44.44}", markup=False)
    columns = described, BarColumn(), TimeElapsedColumn()
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("starting", total=None)

        def announce(what: str, share: float | None) -> None:
            total = None if share is None else 1.0
            bar.update(task, description=printable(what), completed=share or 0.0, total=total)

        yield announce


@contextmanager
def compilation_announced(announce: Announce) -> Iterator[None]:
    """As long as this lasts, what is compiled just in time, which takes seconds, is announced."""
    from numba.core.event import Event, Listener, install_listener

    class Told(Listener):  # type: ignore[misc]
        def on_start(self, event: Event) -> None:
            announce("compiling, only this once", None)

        def on_end(self, event: Event) -> None:
            """Whatever comes next says so itself."""

    with install_listener(COMPILED, Told()):
        yield


def print_rows(rows: Sequence[Mapping[str, object]], *, title: str, as_json: bool) -> None:
    """A table of rows that share their columns, or the same as JSON.

    Of a table wider than the terminal the first columns, and the names of the others.
    """
    if as_json:
        print(json.dumps(list(rows), indent=2))
        return
    console = _console(width=None if sys.stdout.isatty() else PIPE_WIDTH)
    table = Table(
        title=printable(title),
        title_justify="left",
        title_style="bold",
        box=SIMPLE_HEAD,
        pad_edge=False,
    )
    fitting = fitting_columns(rows, console.width)
    for name in fitting:
        numeric = all(isinstance(row[name], int | float | None) for row in rows)
        least = _column_width(name, rows)
        table.add_column(
            printable(name),
            justify="right" if numeric else "left",
            overflow="fold",
            min_width=least,
        )
    for row in rows:
        table.add_row(*[_cell(row[name]) for name in fitting])
    console.print(table)
    others = [printable(name) for name in (rows[0] if rows else []) if name not in fitting]
    if others:
        console.print(f"too wide for this terminal: {', '.join(others)}; --json has all columns")


def fitting_columns(rows: Sequence[Mapping[str, object]], width: int) -> list[str]:
    """The first columns that fit side by side; a long text may take several lines."""
    names = list(rows[0]) if rows else []
    wide = [_column_width(name, rows) + GAP for name in names]
    ends = list(accumulate(wide))
    return [name for k, name in enumerate(names) if k == 0 or ends[k] < width]


def _column_width(name: str, rows: Sequence[Mapping[str, object]]) -> int:
    """As wide as its longest cell, but not wider than a text that may be folded."""
    heading = max((len(word) for word in printable(name).split()), default=0)
    return max(heading, min(max(len(_cell(row[name])) for row in rows), FOLDED))


def _console(**where: Any) -> Console:
    """Where text appears as it stands: what looks like markup is part of a name."""
    return Console(markup=False, emoji=False, **where)


def _cell(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{printable(str(name))} {_cell(item)}" for name, item in value.items())
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 0.01 or abs(value) >= 1000 else f"{value:.2f}"
    return "-" if value is None else printable(str(value))


def print_line(line: str) -> None:
    """A line of the output proper, at once."""
    print(printable(line), flush=True)


def say(message: str) -> None:
    """A line for the person at the terminal, apart from the output proper."""
    with suppress(OSError):
        print(_one_line(message), file=sys.stderr)


def _one_line(message: str) -> str:
    return printable(" ".join(message.strip().split("\n")))


def run_app(typed: typer.Typer, arguments: Sequence[str], name: str) -> int:
    """The exit code of a Typer program; what Typer refuses becomes one line as well."""
    if not arguments:
        typed(arguments)
    try:
        return typed(arguments, prog_name=name, standalone_mode=False) or DONE
    except (typer.Abort, KeyboardInterrupt):
        return INTERRUPTED
    except Exception as error:
        explain = getattr(error, "format_message", None)
        if explain is None:
            raise
        raise ParameterError(f"{explain()} See {name} --help") from error


def exit_code_of(command: Callable[[], int]) -> int:
    """What `command` gives; an error that a user can act on becomes one line and an exit code."""
    try:
        code = command()
        sys.stdout.flush()
    except BrokenPipeError:
        _drop_output()
        return CLOSED_PIPE
    except EXPLAINED as error:
        if (line := _line_of(error)) is None:
            raise
        say(f"elfslam: {line}")
        _drop_output()
        return NO_ANSWER if isinstance(error, NoAnswerError) else BAD_INPUT
    return code


def _line_of(error: Exception) -> str | None:
    """What to tell the user; nothing of a bug."""
    if isinstance(error, MemoryError):
        reason = f" ({error})" if str(error) else ""
        return f"needs more memory than there is{reason}; give it less, or a larger machine"
    if isinstance(error, ModuleNotFoundError):
        extra = extra_with(error.name or "")
        missing = f"this needs {error.name}, which is not installed"
        return extra and f"{missing}; {installing(extra)}"
    if isinstance(error, UnicodeEncodeError):
        return f"{error.object[error.start : error.end]}: is no text in UTF-8; rename the file"
    if isinstance(error, OSError):
        reason = error.strerror or str(error)
        return f"{error.filename or 'file'}: {reason}; check path, rights and free space"
    return str(error)


def _drop_output() -> None:
    """What could not be written out is not tried again, with noise, when the process ends."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
