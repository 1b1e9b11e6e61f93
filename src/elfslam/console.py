"""What a person sees on a terminal: progress, tables, and errors as one line."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from elfslam.base.errors import ElfslamError, NoAnswerError

DONE, NO_ANSWER, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130

Announce = Callable[[str, float | None], None]
"""Hears what is being done, and the share done where it is known."""


@contextmanager
def progress_bar() -> Iterator[Announce]:
    """A progress bar on a terminal, silence in a pipe."""
    console = Console(stderr=True)
    columns = TextColumn("{task.description:<44.44}"), BarColumn(), TimeElapsedColumn()
    with Progress(
        *columns, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task("starting", total=None)

        def announce(what: str, share: float | None) -> None:
            total = None if share is None else 1.0
            bar.update(task, description=what, completed=share or 0.0, total=total)

        yield announce


def print_rows(rows: Sequence[Mapping[str, object]], *, title: str, as_json: bool) -> None:
    """A table of rows that share their columns, or the same as JSON."""
    if as_json:
        print(json.dumps(list(rows), indent=2))
        return
    table = Table(
        title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, pad_edge=False
    )
    for name in rows[0] if rows else []:
        numeric = all(isinstance(row[name], int | float | None) for row in rows)
        table.add_column(name, justify="right" if numeric else "left", overflow="fold")
    for row in rows:
        table.add_row(*[_cell(value) for value in row.values()])
    Console(width=None if sys.stdout.isatty() else 120).print(table)


def _cell(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {_cell(item)}" for name, item in value.items())
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 0.01 or abs(value) >= 1000 else f"{value:.2f}"
    return "-" if value is None else str(value)


def say(message: str) -> None:
    """A line for the person at the terminal, apart from the output proper."""
    print(" ".join(message.split("\n")), file=sys.stderr)


def exit_code_of(command: Callable[[], object]) -> int:
    """Run `command`; an error becomes one line and an exit code."""
    try:
        command()
    except NoAnswerError as failure:
        say(f"elfslam: {failure}")
        return NO_ANSWER
    except ElfslamError as error:
        say(f"elfslam: {error}")
        return BAD_INPUT
    except OSError as error:
        reason = error.strerror or error
        say(f"elfslam: {error.filename or 'file'}: {reason}; check path, rights and free space")
        return BAD_INPUT
    return DONE
