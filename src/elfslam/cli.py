"""One command, thin verbs. Exit codes: 0 done, 1 no honest answer, 2 bad input."""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from elfslam import slam
from elfslam.base.card import card_rows
from elfslam.base.errors import InputError, NoAnswerError, ParameterError
from elfslam.base.parameters import load, rows
from elfslam.base.values import FixStatus
from elfslam.console import DONE, INTERRUPTED, exit_code_of, print_rows, progress_bar, say
from elfslam.data.fixes_files import read_fixes, write_fixes
from elfslam.data.folders import new_file
from elfslam.data.importing import LogFormat, Refused, read_logs, takes_many
from elfslam.data.map_files import read_map
from elfslam.data.recordings import read_recording, write_recording
from elfslam.data.runs import FACTS, read_facts, read_run
from elfslam.line.feature import load_encoder, read_card
from elfslam.mapping import (
    MapJob,
    breaks,
    encoder_of,
    finetune_into,
    line_only,
    map_into,
    map_many,
    parse_start,
    recordings_in,
    versions,
)
from elfslam.score.errors import alignment_of
from elfslam.score.figures import FloorPlan
from elfslam.score.report import write_report
from elfslam.score.tables import ScoreRow, closure_scores, fix_scores, run_scores
from elfslam.score.truth import read_truth
from elfslam.senses import Settings, parse_modalities
from elfslam.studies.catalogue import STUDIES, run_study
from elfslam.studies.demo import floor_plan, run_demo
from elfslam.studies.drawing import drawing_of
from elfslam.studies.walks import score_walks
from elfslam.world.circumstances import ENGINES, SOUNDS, Circumstances, parse_sounds
from elfslam.world.device import DEVICES, GRADES, built_in_grade
from elfslam.world.sensors import parse_sensors
from elfslam.world.simulate import describe_chirp, simulate
from elfslam.world.world_file import load_world, world_names

app = typer.Typer(
    name="elfslam",
    help="Indoor positioning from the sound of a phone.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


ParameterFile = Annotated[
    Path | None, typer.Option("--parameters", help="TOML file of parameters.")
]
Setting = Annotated[list[str] | None, typer.Option("--set", help="group.name=value, repeatable.")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="Same seed, same bytes.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
EncoderName = Annotated[str, typer.Option("--encoder", help="compact, spectral or an ONNX file.")]
Force = Annotated[bool, typer.Option("--force", help="Replace an older run.")]
Plan = Annotated[str | None, typer.Option("--floor-plan", help="World whose plan is drawn below.")]


@app.command()
def demo(
    out: Annotated[Path, typer.Argument(help="Folder for recordings, map and reports.")],
    encoder: EncoderName = "compact",
    parameter_file: ParameterFile = None,
    setting: Setting = None,
    as_json: AsJson = False,
) -> None:
    """Map ten simulated walks, locate ten others in them, write one of each with its reports."""
    parameters = load(Settings(), parameter_file, setting or [])
    with progress_bar() as announce:
        walks, fixes = run_demo(
            out, load_encoder(encoder), line_only(parameters), facts=versions(), announce=announce
        )
    print_rows(walks, title="Mapping, 5 rounds in a room of 60 m2 (m)", as_json=as_json)
    print_rows(fixes, title="A second walk located in each map (m)", as_json=as_json)
    say(f"look at {out / 'score.html'}, {out / 'fixes.html'} and {out / 'run' / 'report.html'}")


@app.command("simulate")
def simulate_command(
    world: Annotated[str, typer.Argument(help=f"{', '.join(world_names())} or a TOML file.")],
    out: Annotated[Path, typer.Argument(help="Folder for the recording and its truth.")],
    seed: Seed = 0,
    rounds: Annotated[int, typer.Option(min=1, help="Laps of the world's route.")] = 5,
    rate_hz: Annotated[int, typer.Option("--rate", help="44100 or 48000 Hz.")] = 44_100,
    reverse: Annotated[bool, typer.Option("--reverse", help="The other way round.")] = False,
    sensors: Annotated[str, typer.Option(help="Besides sound and motion: wifi,magnetic,emr.")] = "",
    state: Annotated[str, typer.Option(help="A state of the world's furniture.")] = "",
    day: Annotated[int, typer.Option(help="Days since the world was drawn.")] = 0,
    people: Annotated[int, typer.Option(help="How many others walk about.")] = 0,
    device: Annotated[str, typer.Option(help=", ".join(DEVICES))] = "simulated phone",
    volume: Annotated[float, typer.Option(help="Share of the phone's full level.")] = 1.0,
    sounds: Annotated[str, typer.Option(help=f"Heard besides: {','.join(SOUNDS)}.")] = "",
    other_phones: Annotated[int, typer.Option(help="How many others chirp in the room.")] = 0,
    engine: Annotated[str, typer.Option(help=" or ".join(ENGINES))] = ENGINES[0],
    imu: Annotated[str, typer.Option(help=", ".join(GRADES))] = "BMI160",
) -> None:
    """Simulate a walk with a phone: a recording, and its truth beside it for scoring."""
    heard = parse_sounds(sounds)
    today = Circumstances(state, day, people, device, volume, heard, other_phones, engine)
    with progress_bar() as announce:
        recording, truth = simulate(
            load_world(world),
            seed,
            rounds=rounds,
            rate_hz=rate_hz,
            reverse=reverse,
            sensors=parse_sensors(sensors),
            grade=built_in_grade(imu),
            circumstances=today,
            progress=lambda share: announce(f"simulating {world}", share),
        )
    write_recording(recording, out, chirp_description=describe_chirp(), truth=truth)
    say(f"wrote {out} ({truth.t_s[-1]:.0f} s)")


@app.command("import")
def import_command(
    log_format: Annotated[LogFormat, typer.Argument(metavar="FORMAT", help=", ".join(LogFormat))],
    path: Annotated[Path, typer.Argument(help="The log, or a folder of them.")],
    out: Annotated[Path, typer.Argument(help="A recording folder; for mall, a folder of them.")],
    drift_seed: Annotated[int, typer.Option(min=0, help="Drift of the magnetic odometry.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Turn someone else's log into recordings."""
    count = damaged = 0
    refused: dict[str, str] = {}
    with progress_bar() as announce:
        for item in read_logs(log_format, path, np.random.default_rng(drift_seed)):
            if isinstance(item, Refused):
                refused[item.name] = item.reason
                continue
            announce(item.recording.name, None)
            folder = out / item.recording.name if takes_many(log_format) else out
            write_recording(item.recording, folder, truth=item.truth)
            count, damaged = count + 1, damaged + item.damaged_lines
    _refuse_if_none("imported", path, refused, count)
    summary = {"format": str(log_format), "recordings": count, "damaged_lines": damaged}
    print_rows([summary], title="Imported", as_json=as_json)
    _say_refused("imported", refused)


def _refuse_if_none(done: str, source: Path, refused: dict[str, str], count: int) -> None:
    if refused and not count:
        reason = next(iter(refused.values()))
        raise InputError(f"{source}: none of {len(refused)} could be {done}; {reason}")


def _say_refused(done: str, refused: dict[str, str]) -> None:
    for name, reason in refused.items():
        say(f"not {done}: {name}: {reason}")
    if refused:
        raise NoAnswerError(f"{len(refused)} could not be {done}, see above")


@app.command("map")
def map_command(
    recording: Annotated[Path, typer.Argument(help="A recording, or a folder of recordings.")],
    out: Annotated[Path, typer.Argument(help="The run folder, or the folder of run folders.")],
    by: Annotated[str | None, typer.Option(help="elf,magnetic: default elf with sound.")] = None,
    start: Annotated[str | None, typer.Option(help="X,Y,HEADING of the start, m and rad.")] = None,
    encoder: EncoderName = "compact",
    finetune: Annotated[bool, typer.Option(help="The encoder first learns this walk.")] = False,
    calibrate: Annotated[bool, typer.Option(help="For other phones to be located.")] = False,
    plan: Plan = None,
    force: Force = False,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
) -> None:
    """Map a recording: dead reckoning, closures, straightened trajectory, map and report."""
    known = load(Settings(), parameter_file, setting or [])
    drawn = _plan(plan)
    job = MapJob(
        parse_modalities(by), parse_start(start), encoder, known, force, finetune, calibrate
    )
    paths = recordings_in(recording)
    with progress_bar() as announce:
        if paths == [recording]:
            run = map_into(out, recording, job, announce, drawn)
        else:
            refused = map_many(out, paths, job, announce)
    if paths == [recording]:
        _say_mapped(run, out)
    else:
        mapped = len(paths) - len(refused)
        _refuse_if_none("mapped", recording, refused, mapped)
        say(f"mapped {mapped} of {len(paths)} recordings into {out}")
        _say_refused("mapped", refused)


def _say_mapped(run: slam.Run, out: Path) -> None:
    for line in [] if run.echoes is None else breaks(run.echoes):
        say(line)
    if "finetuning" in (facts := read_facts(out)):
        say(f"fine-tuning: {facts['finetuning']}")
    kept = int((run.trajectory.closure_weights > 0.5).sum())
    say(
        f"{len(run.trajectory.t_s)} footsteps, {len(run.closures.i)} closures, {kept} kept; "
        f"look at {out / 'report.html'}"
    )
    if run.trajectory.status != "OK" and run.similarity.kind != "motion":
        raise NoAnswerError(
            f"{run.name}: no loop closure held, the trajectory is dead reckoning; "
            "walk at least two rounds of the same route"
        )


@app.command("locate")
def locate_command(
    recording: Annotated[Path, typer.Argument(help="The recording to be located.")],
    floor_map: Annotated[Path, typer.Argument(metavar="MAP", help="A run folder.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.csv", help="Where the fixes go.")],
    encoder: Annotated[str | None, typer.Option(help="Default: the one beside the map.")] = None,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
    as_json: AsJson = False,
) -> None:
    """Locate a recording in a map, one fix per 0.6 s of sound."""
    parameters = load(Settings(), parameter_file, setting or [])
    known = read_map(floor_map)
    used = load_encoder(encoder) if encoder else encoder_of(floor_map, known)
    with progress_bar() as announce:
        announce("locating", None)
        heard = read_recording(recording, parameters.chirp)
        fixes = slam.locate(heard, known, used, parameters)
    write_fixes(fixes, out)
    counts = {status.name: int((fixes.status == status).sum()) for status in FixStatus}
    print_rows(
        [{"fixes": len(fixes.t_s), **counts}], title=f"Located in {floor_map}", as_json=as_json
    )
    if counts["OK"] == 0:
        raise NoAnswerError(f"{recording}: nowhere in {floor_map}; is it the same place?")


@app.command()
def score(
    estimate: Annotated[Path, typer.Argument(metavar="RUN|FIXES", help="A run, runs, or a CSV.")],
    truth: Annotated[Path, typer.Argument(help="Truth file or recording, or a folder of them.")],
    mapped: Annotated[Path | None, typer.Option("--map", help="Run that the fixes lie in.")] = None,
    map_truth: Annotated[Path | None, typer.Option(help="Truth of that run.")] = None,
    plan: Plan = None,
    as_json: AsJson = False,
) -> None:
    """Compare a run, a folder of runs, or fixes with the truth; a run gets its score.html."""
    if estimate.suffix == ".csv":
        _score_fixes(estimate, truth, mapped, map_truth, as_json=as_json)
    elif not estimate.is_dir():
        raise InputError(f"{estimate}: wanted a run folder or a CSV of fixes; check the path")
    elif (estimate / FACTS).exists():
        _score_run(estimate, truth, plan, as_json=as_json)
    else:
        table, left_out = score_walks(estimate, truth)
        print_rows(table, title=f"Runs in {estimate}", as_json=as_json)
        for name, reason in left_out.items():
            say(f"not scored: {name}: {reason}")


def _score_run(folder: Path, truth_path: Path, plan: str | None, *, as_json: bool) -> None:
    run, truth, drawn = read_run(folder), read_truth(truth_path), _plan(plan)
    print_rows(run_scores(run, truth), title=f"{run.name}: errors (m)", as_json=as_json)
    if len(run.closures.i) and not as_json:
        print_rows(closure_scores(run, truth), title="Closures", as_json=False)
    with new_file(folder / "score.html") as page:
        write_report(page, run, facts=read_facts(folder), floor_plan=drawn, truth=truth)


def _score_fixes(
    file: Path, truth_path: Path, mapped: Path | None, map_truth: Path | None, *, as_json: bool
) -> None:
    if (mapped is None) != (map_truth is None):
        raise InputError("score: --map and --map-truth go together; give both or neither")
    move = np.zeros(3)
    if mapped is not None and map_truth is not None:
        move = alignment_of(read_run(mapped).trajectory, read_truth(map_truth))
    table: list[ScoreRow] = fix_scores(read_fixes(file), read_truth(truth_path), move)
    print_rows(table, title=f"{file.name}: errors (m)", as_json=as_json)


@app.command()
def show(
    what: Annotated[str, typer.Argument(metavar="RUN|MAP|WORLD", help="What to look at.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.html", help="Where the page goes.")],
) -> None:
    """Draw a run, a map or a world as a page."""
    draw = drawing_of(what)
    with new_file(out) as page:
        draw(page)
    say(f"look at {out}")


@app.command()
def study(
    name: Annotated[str, typer.Argument(help=", ".join(STUDIES))],
    out: Annotated[Path, typer.Argument(help="Folder for the table, as JSON and as CSV.")],
    data: Annotated[
        Path | None, typer.Option(envvar="ELFSLAM_DATA", help="Folder of real recordings.")
    ] = None,
    encoder: Annotated[list[str] | None, typer.Option(help="To be measured, repeatable.")] = None,
    as_json: AsJson = False,
) -> None:
    """Make the table of a study."""
    encoders = {Path(file).stem: load_encoder(file) for file in encoder or []}
    with progress_bar() as announce:
        table = run_study(name, out, data, announce, encoders=encoders)
    print_rows(table, title=f"Study: {name}", as_json=as_json)


@app.command()
def parameters(
    parameter_file: ParameterFile = None, setting: Setting = None, as_json: AsJson = False
) -> None:
    """Every parameter, its value, unit and meaning."""
    known = load(Settings(), parameter_file, setting or [])
    table = [asdict(row) for row in rows(known)]
    if not as_json:
        table = [{**row, "value": str(row["value"])} for row in table]
    print_rows(table, title="Parameters", as_json=as_json)


@app.command("pretrain")
def pretrain_command(
    out: Annotated[Path, typer.Argument(metavar="OUT.onnx", help="Where the encoder goes.")],
    seed: Seed = 0,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
) -> None:
    """Train an encoder on simulated echoes; goes on after a kill."""
    from elfslam.studies.pretraining import pretrain_on_simulated_echoes

    known = load(Settings(), parameter_file, setting or []).pretrain
    with progress_bar() as announce:
        loss = pretrain_on_simulated_echoes(out, known, seed=seed, announce=announce)
    say(f"wrote {out}; mean loss of the last tenth: {loss:.3f}")


@app.command("finetune")
def finetune_command(
    recording: Annotated[Path, typer.Argument(help="The walk to learn.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.onnx", help="Where the encoder goes.")],
    encoder: EncoderName = "compact",
    seed: Seed = 0,
    parameter_file: ParameterFile = None,
    setting: Setting = None,
) -> None:
    """Fine-tune an encoder on one recording, without labels; kept as it is where that is better."""
    known = load(Settings(), parameter_file, setting or [])
    with progress_bar() as announce:
        found = finetune_into(out, recording, encoder, known, seed=seed, announce=announce)
    say(f"wrote {out}; {found}")


@app.command()
def card(
    encoder: Annotated[str, typer.Argument(help="compact or an ONNX file.")] = "compact",
    as_json: AsJson = False,
) -> None:
    """What an encoder is, and how to train it again: as its own file says."""
    known = read_card(encoder)
    if known is None:
        raise NoAnswerError(f"encoder {encoder}: carries no card, so how it was made is not known")
    print_rows(list(card_rows(known)), title=f"Encoder {encoder}", as_json=as_json)


def _plan(world: str | None) -> FloorPlan | None:
    return None if world is None else floor_plan(load_world(world).room)


def _run_app() -> None:
    """The commands; what Typer refuses becomes one line as well."""
    if len(sys.argv) == 1:
        app()
    try:
        sys.exit(app(standalone_mode=False) or DONE)
    except (typer.Abort, KeyboardInterrupt) as stop:
        raise SystemExit(INTERRUPTED) from stop
    except Exception as error:
        explain = getattr(error, "format_message", None)
        if explain is None:
            raise
        raise ParameterError(f"{explain()} See elfslam --help") from error


def main() -> None:
    """The `elfslam` command."""
    sys.exit(exit_code_of(_run_app))
