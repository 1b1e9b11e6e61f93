"""`python -m studies NAME`, `all` or `render`: measure, measure what is stale, show."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from elfslam.app.console import exit_code_of, print_rows, progress_bar, run_app, say
from elfslam.app.stopping import run_stoppable
from elfslam.stages.feature import load_encoder
from elfslam.world.kinds import KINDS
from studies.catalogue import STUDIES, Choice, run_stale, run_study, sample_study, study_named
from studies.results import RESULTS, Result

FAST = Path("results-fast")
"""Where studies put what is not for docs: of small variants, other encoders, own recordings."""


def study(
    name: Annotated[str, typer.Argument(help=f"all, render, {', '.join(STUDIES)}")],
    out: Annotated[Path | None, typer.Option(help="Folder for NAME.csv; results/ usually.")] = None,
    data: Annotated[
        Path | None, typer.Option(envvar="ELFSLAM_DATA", help="Folder of real recordings.")
    ] = None,
    encoder: Annotated[list[str] | None, typer.Option(help="To be measured, repeatable.")] = None,
    kind: Annotated[
        str | None, typer.Option(help=f"Whose walks, in what life: {', '.join(KINDS)}.")
    ] = None,
    on: Annotated[
        str | None,
        typer.Option("--on", help="Who works: a number of processes, ray or ray://HOST:10001."),
    ] = None,
    only: Annotated[str, typer.Option(help="all: these studies, by commas.")] = "",
    fast: Annotated[bool, typer.Option("--fast", help="A small variant, in seconds.")] = False,
    check: Annotated[
        bool, typer.Option("--check", help="render: change nothing, compare.")
    ] = False,
    recording: Annotated[
        Path | None, typer.Option(help="paper: a recording of one's own, in place of the worlds.")
    ] = None,
    sample: Annotated[
        int | None, typer.Option(min=1, help="Time so many repeats of each of --only, no more.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, not a table.")] = False,
) -> None:
    """Make the results of a study, of all that are stale, or render README and docs."""
    if name == "render":
        raise typer.Exit(_render(check=check))
    encoders = {Path(file).stem: load_encoder(file) for file in encoder or []}
    elsewhere = fast or recording is not None or bool(encoders)
    folder = out or (FAST if elsewhere else RESULTS)
    choice = Choice(folder, data, on, fast, kind, encoders, recording)
    if sample is not None:
        names = [each for each in only.split(",") if each] if name == "all" else [name]
        rows = []
        for each in names:
            rows.append(sample_study(each, choice, sample))
            say(str(rows[-1]))
        print_rows(rows, title="Processor seconds a repeat, hours on two cores", as_json=as_json)
        return
    if name != "all" and not fast:
        say(f"{name}: about {study_named(name).minutes:g} min on two cores")
    with progress_bar() as announce:
        if name == "all":
            for done in run_stale([each for each in only.split(",") if each], choice, announce):
                say(f"{done.name} {done.kind or ''}: done ({done.why})")
            return
        results = run_study(name, choice, announce)
    print_rows(short(results), title=f"Study: {name}", as_json=as_json)


def short(results: Sequence[Result]) -> list[dict[str, object]]:
    """Results as people read them on a terminal: a column for each metric."""
    found: dict[tuple[str, ...], dict[str, object]] = {}
    for each in results:
        of = {"world": each.world, "scenario": each.scenario, "method": each.method,
              "condition": each.condition}  # fmt: skip
        row = found.setdefault(
            tuple(of.values()), {key: value for key, value in of.items() if value}
        )
        row[each.metric] = f"{each.value:.4g}"
    columns = dict.fromkeys(name for row in found.values() for name in row)
    return [{name: row.get(name, "") for name in columns} for row in found.values()]


def _render(*, check: bool) -> int:
    from studies.render import differences, render

    if not check:
        for file in render():
            say(f"{file}: made anew")
        return 0
    found = differences()
    for line in found:
        say(line)
    return int(bool(found))


def run(arguments: Sequence[str]) -> int:
    """The exit code of `python -m studies ARGUMENTS`."""
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command()(study)
    return exit_code_of(lambda: run_app(app, arguments or ["--help"], "python -m studies"))


if __name__ == "__main__":
    run_stoppable(lambda: run(sys.argv[1:]))
