"""All verbs. Exit codes: 0 done, 1 no honest answer, 2 bad input, 130 interrupted."""

import os
import resource
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from elfslam.app.console import exit_code_of, run_app
from elfslam.base.errors import ElfslamError
from elfslam.data.atomic_files import place_of, refuse_read

VERBS: Mapping[str, tuple[str, str]] = {
    "demo": ("mapping:demo", "Map ten simulated walks and locate ten others in them."),
    "simulate": ("recordings:simulate_command", "Simulate a walk with a phone, with its truth."),
    "import": ("recordings:import_command", "Turn someone else's log into recordings."),
    "phyphox": ("recordings:phyphox_command", "Write an experiment for the phyphox app."),
    "marks": ("recordings:marks_command", "Give a walk its truth: the marks it stood on."),
    "map": ("mapping:map_command", "Map a recording, or a folder of them."),
    "merge": ("mapping:merge_command", "Merge runs into one floor map."),
    "superimpose": (
        "mapping:superimpose_command",
        "One feature per spot of a merged map, for all headings.",
    ),
    "locate": ("locate:locate_command", "Locate a recording in a map."),
    "score": ("maps:score", "Compare runs or fixes with the truth."),
    "anchor": ("maps:anchor_command", "Place a map on a floor plan."),
    "export": ("maps:export_command", "Write a run or a map for other programs."),
    "way": ("maps:way_command", "Tell the way between two places of a building."),
    "show": ("maps:show", "Draw a run, a map or a world as one file."),
    "parameters": ("training:parameters", "Every parameter, its value, unit and meaning."),
    "pretrain": ("training:pretrain_command", "Train an encoder on simulated echoes."),
    "finetune": ("training:finetune_command", "Fine-tune an encoder on one recording."),
    "card": ("training:card", "What an encoder is, and how to train it again."),
    "serve": ("server:serve_command", "Run the server and its phone page."),
    "invite": ("server:invite_command", "Let somebody else use the server."),
    "publish": ("server:publish_command", "Let phones find and fetch the map of a floor."),
    "withdraw": ("server:withdraw_command", "Take a published floor back."),
    "buildings": ("server:buildings_command", "List what is published."),
}
"""Where each verb stands in this room, and what it does. Its module is imported when it runs."""
HINTS = {
    "by": "elfslam map --by elf",
    "encoder": "elfslam map --encoder",
    "minutes": "elfslam phyphox --minutes",
}
"""By what an argument is given that would help, where not by an option of the same name."""

LIMITS = {"ulimit -v": resource.RLIMIT_AS, "ulimit -d": resource.RLIMIT_DATA}
LOADED_BYTES, THREAD_BYTES = 900_000_000, 100_000_000
"""What the libraries take of addresses, and what their threads add for each core."""
MOST_THREADS = 64


class Verb(TyperCommand):
    """A verb; where its result cannot go is said before anything is done."""

    def invoke(self, ctx: Any) -> Any:
        given = dict(ctx.params)
        if (out := given.pop("out", None)) is not None:
            place_of(out)
            refuse_read(out, _texts_in(given.values()))
        try:
            return super().invoke(ctx)
        except ElfslamError as error:
            if hint := self._hint(error.argument):
                error.args = (f"{error}{hint}",)
            raise

    def _hint(self, argument: str) -> str:
        own = {each.name: each.opts[-1] for each in self.params if each.opts[-1].startswith("--")}
        if argument == "overwrite":
            return f", or replace an older result with {own['force']}" if "force" in own else ""
        found = own.get(argument) or HINTS.get(argument)
        return f" ({found})" if found else ""


def _texts_in(values: Iterable[object]) -> Iterator[str]:
    """Whatever may name a file that is read; of a plan and its width the plan."""
    for value in values:
        if isinstance(value, list | tuple):
            yield from _texts_in(value)
        elif isinstance(value, str | Path):
            text = str(value)
            yield from (each for each in (text, text.rpartition(":")[0]) if each)


class Verbs(TyperGroup):
    """The verbs by name: help lists them without importing any.

    Types of Click stand as Any: Typer carries its own copy and calls it private.
    """

    def list_commands(self, ctx: Any) -> list[str]:
        return list(VERBS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        return command_of(cmd_name) if cmd_name in VERBS else None

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, what) for name, (_, what) in VERBS.items()])


def refuse_scarce_memory() -> None:
    """Raise MemoryError where this process may not have what loading the libraries takes.

    OpenBLAS asks again for ever for the memory that it does not get.
    """
    cores = min(len(os.sched_getaffinity(0)), MOST_THREADS)
    wanted = LOADED_BYTES + THREAD_BYTES * cores
    for name, limit in LIMITS.items():
        allowed = resource.getrlimit(limit)[0]
        if resource.RLIM_INFINITY != allowed < wanted:
            raise MemoryError(
                f"got {allowed // 10**6} MB by {name}, wanted {wanted // 10**6} MB for a start"
            )


def verb_of(name: str) -> Callable[..., None]:
    """The function behind a verb. Raises MemoryError where its libraries would not fit."""
    refuse_scarce_memory()
    module, function = VERBS[name][0].split(":")
    found: Callable[..., None] = getattr(import_module(f"elfslam.cli.{module}"), function)
    return found


def command_of(name: str) -> Any:
    """A verb with its options, as Typer reads them from its function."""
    alone = typer.Typer(add_completion=False, rich_markup_mode=None)
    alone.command(name, cls=Verb)(verb_of(name))
    return typer.main.get_command(alone)


app = typer.Typer(
    name="elfslam",
    cls=Verbs,
    help="Indoor positioning from the sound of a phone.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


@app.callback()
def elfslam() -> None:
    """Indoor positioning from the sound of a phone."""


def run(arguments: Sequence[str]) -> int:
    """The exit code of `elfslam ARGUMENTS`, once it has been run."""
    return exit_code_of(lambda: run_app(app, arguments, "elfslam"))
