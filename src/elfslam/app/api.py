"""The door for Python users: what the commands do, on values, in one call with their defaults.

    import elfslam
    recording, truth = elfslam.simulate("living_room", seed=0)
    run = elfslam.map(recording)
    run.plot(truth)

Bad input raises what the command says, an exception of one line: InputError, ParameterError,
StoreError or NoAnswerError, all of them ElfslamError. What the world does not tell is a value:
`Trajectory.status`, `FixStatus`.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from elfslam.app.locate import phone_translation
from elfslam.app.map import MapJob, Pose, map_recording
from elfslam.app.map import finetuned as finetuned_encoder
from elfslam.app.settings import Settings
from elfslam.base.arguments import Seed, Such, checked
from elfslam.base.bounds import FARTHEST_M
from elfslam.base.enums import LONGEST_S, Modality, Mode, parse_modalities, parse_stretch
from elfslam.base.errors import InputError, NoAnswerError, ParameterError
from elfslam.base.parameters import load
from elfslam.base.parameters import replace as with_parameter
from elfslam.base.values import Announce, Fixes, FloorMap, Recording, Run, Truth, silent
from elfslam.slam import pipeline
from elfslam.slam.crop import crop
from elfslam.slam.floor_location import locate_in_building
from elfslam.slam.floors import floor_runs
from elfslam.slam.front_end import extract_echoes
from elfslam.slam.merging import MappedWalk, add_walk, lay_walk, walk_of
from elfslam.slam.merging import merge as merge_walks
from elfslam.slam.pipeline import Sense
from elfslam.stages.feature import Encoder, load_encoder

SettingsLike = Settings | Mapping[str, Any] | Path | str | None
"""Parameters as one likes to give them: all, some by name, or a TOML file."""
Start = Annotated[
    Pose,
    Such(
        lambda pose: all(abs(each) < FARTHEST_M for each in pose),
        f"(x, y, heading) in m, m and rad, each under {FARTHEST_M:g}",
    ),
]
Seconds = Annotated[
    float, Such(lambda t_s: 0 <= t_s <= LONGEST_S, f"seconds from 0 to {LONGEST_S:g}")
]
Way = Annotated[str, Such(lambda text: text in set(Mode), " or ".join(Mode))]
Senses = Annotated[Sequence[Sense], Such(bool, "list with a Sense")]
Walked = Annotated[Truth, Such(lambda truth: len(truth.t_s) > 0, "Truth of one row or more")]
SHIPPED = ("compact", "spectral")


@checked
def settings_of(given: SettingsLike = None) -> Settings:
    """All parameters: the defaults, changed by {"closure.threshold": 0.5} or by a TOML file.

    Raises ParameterError and InputError.
    """
    if isinstance(given, Settings):
        return given
    if isinstance(given, Path | str):
        return load(Settings(), Path(given), [])
    settings = Settings()
    for name, value in (given or {}).items():
        settings = with_parameter(settings, name, value)
    return settings


@checked
def simulate(
    world: Path | str = "living_room",
    seed: Seed = 0,
    *,
    kind: str = "surveyor",
    asking: bool = False,
    **walk: Any,
) -> tuple[Recording, Truth]:
    """A simulated walk with a phone, and its truth. Same world and seed, same bytes.

    `world` is a built-in name or a TOML file, of one floor or of a building, whose walk takes
    `plan=(0, 1, 0)` besides. `kind` is surveyor (who keeps to one line), people or quiet; who is
    `asking` comes on another day with another phone, people by other ways. `walk` holds keywords of
    `world.simulate.simulate`, such as `rounds=5`, `rate_hz=48_000`, `reverse=True`. Raises
    InputError and ParameterError.
    """
    from elfslam.world.building import load_place
    from elfslam.world.kinds import kind_named
    from elfslam.world.simulate_building import simulate_place, usual_day

    whose = kind_named(kind)
    today, place = usual_day(load_place(world), whose, seed, asking=asking)
    usual: dict[str, Any] = {"walker": whose.walker, "circumstances": today}
    return simulate_place(place, seed, **usual | walk)


@checked
def map(
    recording: Recording,
    *,
    by: str | Sense | Senses | None = None,
    start: Start | None = None,
    encoder: str | Encoder = "compact",
    from_s: Seconds | None = None,
    until_s: Seconds | None = None,
    settings: SettingsLike = None,
    announce: Announce = silent,
) -> Run:
    """Simultaneous localization and mapping of one recording: trajectory, closures, floor map.

    `by` names modalities ("elf,wifi"), or is one or several `Sense`s of your own: what makes a
    similarity between footsteps, and what then counts as a closure. `start` is the declared pose
    (m, m, rad). `encoder` is a name, a file, or an `Encoder` of your own. Only what lies between
    `from_s` and `until_s` is mapped, where they are given. Raises InputError, ParameterError and
    NoAnswerError.
    """
    known, kept_s = settings_of(settings), parse_stretch(from_s, until_s)
    recording = recording if kept_s is None else crop(recording, *kept_s)
    if by is not None and not isinstance(by, str):
        senses = [by] if isinstance(by, Sense) else list(by)
        return pipeline.map_by(_started(recording, start), senses, known, announce=announce)
    named = parse_modalities(by)
    if isinstance(encoder, str):
        job = MapJob(named, start, encoder, known, overwrite=False)
        return map_recording(recording, job, announce).run
    if named not in ((), (Modality.ELF,)):
        raise ParameterError(
            f"by={by!r}: wanted none or elf beside an encoder of your own; name a shipped encoder"
        )
    return pipeline.map_by_echoes(_started(recording, start), encoder, known, announce=announce)


@checked
def finetune(
    recording: Recording,
    *,
    encoder: str = "compact",
    seed: Seed = 0,
    settings: SettingsLike = None,
    announce: Announce = silent,
) -> Encoder:
    """The encoder fine-tuned on one recording without labels; kept as it is where that is better.

    Raises InputError.
    """
    known = settings_of(settings)
    echoes, shipped = extract_echoes(recording, known), load_encoder(encoder)
    return finetuned_encoder(shipped, echoes, known.finetune, seed, announce).encoder


@checked
def merge(
    runs: Sequence[Run | FloorMap],
    *,
    known_starts: bool = False,
    settings: SettingsLike = None,
    announce: Announce = silent,
) -> FloorMap:
    """One floor map of several runs, the oldest first; or of a map and runs that join it.

    With `known_starts` all lie in one frame. Raises InputError where they cannot be compared and
    NoAnswerError where nothing tells how they lie to each other.
    """
    known = settings_of(settings)
    maps = [item for item in runs if isinstance(item, FloorMap)]
    walks = _named_walks([item for item in runs if isinstance(item, Run)])
    if any(isinstance(item, Run) and item.visited is not None for item in runs):
        raise InputError(
            "merge: a run is over several floors; merge their folders with `elfslam merge`"
        )
    if len(maps) > 1 or len(runs) < 2:
        raise InputError(
            f"merge: wanted two runs or more, or one map and runs, got {len(maps)} maps and "
            f"{len(walks)} runs; name others"
        )
    if maps:
        return _grown(maps[0], walks, known, known_starts=known_starts)
    found = merge_walks(walks, known, known_starts=known_starts, announce=announce)
    if not found.maps:
        name, why = next(iter(found.refused.items()))
        raise NoAnswerError(f"merge: no two walks could be merged; {name}: {why}")
    return found.maps[0].floor_map


@checked
def locate(
    recording: Recording,
    floor_map: FloorMap | Run,
    *,
    mode: Way = Mode.ONE_SHOT,
    encoder: str | Encoder | None = None,
    seed: Seed = 0,
    phone_walk: Recording | None = None,
    settings: SettingsLike = None,
) -> Fixes:
    """Fixes of a recording in a map: where it was, how surely, and where that cannot be said.

    `mode` is one-shot (place recognition from 0.6 s of sound), trajectory (8 footsteps) or track
    (particle filter, whose draws `seed` decides). `encoder` is needed where the map was made with
    one of your own. `phone_walk` is a walk of this phone in that map, to learn how it hears.
    In a run over several floors each fix has a level. Raises InputError and ParameterError.
    """
    known, floors = settings_of(settings), _floors_of(floor_map)
    where = _map_of(floor_map) if floors is None else next(iter(floors.values()))
    used = _encoder_for(where) if encoder is None else encoder
    used = load_encoder(used) if isinstance(used, str) else used
    if floors is not None:
        if phone_walk is not None:
            raise InputError("phone_walk: no phone is learned in a building yet; leave it out")
        return locate_in_building(recording, floors, used, known, mode=Mode(mode), seed=seed)
    translation = None
    if phone_walk is not None:
        translation = phone_translation(phone_walk, where, used, known)
    return pipeline.locate(
        recording, where, used, known, mode=Mode(mode), seed=seed, translation=translation
    )


class ScoreTable(list[dict[str, object]]):
    """Rows of scores, which a notebook shows as a table."""

    def _repr_html_(self) -> str:
        from elfslam.scoring.page import rows_table

        return rows_table(self)


@checked
def score(
    estimate: Run | Fixes,
    truth: Walked,
    *,
    mapped: Run | None = None,
    map_truth: Walked | None = None,
) -> ScoreTable:
    """Errors against the truth: rows by method and alignment of a run, by status of fixes.

    Fixes are scored in the frame of the truth; `mapped` and `map_truth` are the run that they lie
    in and its truth, which bring them there. Raises InputError.
    """
    from elfslam.scoring.errors import alignment_of, fix_scores, run_scores

    if isinstance(estimate, Run):
        return ScoreTable(run_scores(estimate, truth))
    if (mapped is None) != (map_truth is None):
        raise InputError("score: mapped and map_truth go together; give both or neither")
    if mapped is None or map_truth is None:
        return ScoreTable(fix_scores(estimate, truth, pipeline.AS_MAPPED))
    return ScoreTable(fix_scores(estimate, truth, alignment_of(mapped.trajectory, map_truth)))


@checked
def plot(
    value: Run | FloorMap | Fixes, truth: Walked | None = None, floor_map: FloorMap | None = None
) -> Any:
    """A drawing (plotly.graph_objects.Figure) of a run, a map, or fixes over the map they lie in.

    A run with its truth is aligned onto it. Raises ParameterError.
    """
    from elfslam.scoring.report import fix_plot, map_plot, walk_plot

    if isinstance(value, Run):
        return walk_plot(value, truth)
    if isinstance(value, FloorMap):
        return map_plot(value)
    return fix_plot(value, floor_map, truth)


def _started(recording: Recording, start: Pose | None) -> Recording:
    return recording if start is None else replace(recording, start_pose=start)


def _named_walks(runs: Sequence[Run]) -> list[MappedWalk]:
    """Walks under names of their own: what is called alike is numbered."""
    same, seen, walks = Counter(run.name for run in runs), Counter[str](), []
    for run in runs:
        seen[run.name] += 1
        name = run.name if same[run.name] == 1 else f"{run.name} {seen[run.name]}"
        walks.append(replace(walk_of(run), name=name))
    return walks


def _grown(
    floor_map: FloorMap, walks: Sequence[MappedWalk], settings: Settings, *, known_starts: bool
) -> FloorMap:
    for walk in walks:
        if walk.name in floor_map.sources:
            raise InputError(f"merge: {walk.name} is in the map already; leave it out")
        if known_starts:
            floor_map, _ = lay_walk(floor_map, walk, settings)
            continue
        floor_map, found, _ = add_walk(floor_map, walk, settings)
        if found.refusal:
            raise NoAnswerError(f"merge: {walk.name} could not be added; {found.refusal}")
    return floor_map


def _map_of(given: FloorMap | Run) -> FloorMap:
    floor_map = given.floor_map if isinstance(given, Run) else given
    if floor_map is None:
        raise InputError("locate: this run was mapped without sound; map it by echoes")
    return floor_map


def _floors_of(given: FloorMap | Run) -> dict[int, FloorMap] | None:
    """The maps of a run over several floors by level; None of any other."""
    if not isinstance(given, Run) or given.visited is None:
        return None
    parts = floor_runs(given, Settings())
    return {level: _map_of(part) for level, part in parts.items()}


def _encoder_for(floor_map: FloorMap) -> Encoder:
    wanted = {item.encoder for item in floor_map.payloads}
    for encoder in (load_encoder(name) for name in SHIPPED):
        if wanted <= {encoder.identity}:
            return encoder
    raise InputError(
        f"locate: the map was made with encoder {', '.join(sorted(wanted))}; pass it as encoder"
    )
