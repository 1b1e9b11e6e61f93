"""The paper's own recipe in a hard world, beside the paper's own figures.

Echoes are compared by the compact network, which has heard one phone in simulated rooms and then
the walk that it maps. Loops are closed by the paper's curation from its threshold of 0.4, step
lengths are those of dead reckoning, and a window of 0.6 s is where the most alike spot is, whatever
else is alike: nothing of what this project adds. Laps are a surveyor's, the sound is that of the
diffuse engine, phones are ordinary ones, rooms are lived in. No constant was fitted to these rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import plotly.graph_objects as go

from elfslam.app.settings import Settings
from elfslam.base.choices import Mode
from elfslam.base.parameters import digest
from elfslam.base.values import Echoes, Features, Odometry, Recording, Run, Truth
from elfslam.learn.parameters import PretrainParameters, ScratchParameters
from elfslam.line.feature import Encoder, OnnxEncoder
from elfslam.line.floormap import trajectory_map
from elfslam.line.graph import build_graph, optimise
from elfslam.line.segments import SegmentParameters
from elfslam.line.similarity import echo_sequence_similarity
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.slam.front_end import hear, walk_nodes
from elfslam.world.circumstances import Circumstances
from elfslam.world.kinds import ASKING_PHONE, MAPPING_PHONE, SURVEYOR
from elfslam.world.simulate import load_world, simulate
from studies.curation import CurationParameters, curated_closures
from studies.figures.dots import Dot, dots_by, dots_figure
from studies.finding import Finding, Given, Row
from studies.intervals import mean_interval
from studies.located import MAPPING_ROUNDS, Mapped, at_its_start, fix_numbers, located, stranger
from studies.mapping import CALIBRATED, trajectory_errors, walkers
from studies.plain_features import ALWAYS, PLAIN, compared_encoders
from studies.repeats import Numbers, by_world, finished
from studies.simulated_walk import SimulatedWalk

WORLDS = ("living_room", "office", "mall")
SEEDS = tuple(range(5))
ROUNDS = 2
PAPER_M: Mapping[str, Mapping[str, float]] = {
    "mapping": {"living_room": 0.10, "office": 0.63, "mall": 0.45},
    "mapping, no pre-training": {"living_room": 0.73, "office": 1.69, "mall": 1.16},
    "one-shot": {"living_room": 0.10, "office": 0.54, "mall": 0.42},
    "trajectory": {"living_room": 0.10, "office": 0.41, "mall": 0.47},
    "volume 20 %": {"living_room": 0.18, "office": 0.68, "mall": 0.56},
    "cheap phone": {"living_room": 2.54},
    "another good phone": {"living_room": 0.5},
    "8 people": {"living_room": 0.6},
    "furniture moved, mean": {"living_room": 1.3},
    "30 days later": {"living_room": 0.12},
    "opposite heading": {"living_room": 3.8},
}
"""Medians in metres (the furniture's is a mean) in three real places."""
USUAL = Circumstances(engine="diffuse", device=MAPPING_PHONE, lived_in=True)
CHANGES: Mapping[str, Circumstances] = {
    "volume 20 %": replace(USUAL, volume=0.2),
    "cheap phone": replace(USUAL, device="cheap"),
    "another good phone": replace(USUAL, device=ASKING_PHONE),
    "8 people": replace(USUAL, people=8),
    "furniture moved, mean": replace(USUAL, state="moved"),
    "30 days later": replace(USUAL, day=30),
}
SEGMENTS = replace(SegmentParameters(), unknown_below=0.58, temperature=0.015)
"""For features as they were heard, which are more alike."""
FINETUNING_RATE = 2e-4
"""Peak learning rate of what has learnt before; the paper tells none."""
FACTOR = 2.0
"""Within this the world errs as the paper says."""
NOTE = "Median error, mean over walks with its 95 % interval, beside the paper's figure."


def measure_paper(
    given: Given,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = MAPPING_ROUNDS,
    scratch: ScratchParameters | None = None,
    pretraining: PretrainParameters | None = None,
) -> Finding:
    """A row per world and figure of the paper: ours, theirs and the ratio.

    The encoder that has heard no walk yet stays beside what is kept, by the digest of its recipe.
    """
    from studies.paper_training import AS_IN_PAPER, pretrain_as_in_paper

    tasks = [SimulatedWalk(world, seed, rounds) for world in worlds for seed in seeds]
    recipe = pretraining or AS_IN_PAPER
    with _encoders(given) as folder:
        file = folder / f"as_in_paper_{digest(recipe)}.onnx"
        if not file.exists():
            pretrain_as_in_paper(file, recipe, given.announce)
        measure = partial(_measured, file=file, scratch=scratch or ScratchParameters(threads=1))
        numbers = finished(measure, tasks, given)
    rows = paper_rows(by_world(tasks, numbers))
    return Finding(rows, _page(rows))


@contextmanager
def _encoders(given: Given) -> Iterator[Path]:
    """The folder of what is trained; a passing one where nothing is kept."""
    if given.kept is not None:
        yield given.kept.parent / "encoders"
        return
    with TemporaryDirectory() as folder:
        yield Path(folder)


def _measured(walk: SimulatedWalk, file: Path, scratch: ScratchParameters) -> Numbers:
    world = load_world(walk.world)
    recording, truth = simulate(world, walk.seed, rounds=walk.rounds, circumstances=USUAL)
    recording = at_its_start(recording, truth)
    known, echoes = walkers(walk.seed, SURVEYOR)[CALIBRATED], hear(recording, Settings())
    nodes = walk_nodes(recording, known)
    encoder = _finetuned(file, echoes, scratch, walk.seed)
    mapped = Mapped(recording, _mapped(recording, echoes, nodes, encoder, known), truth)
    numbers = {
        "mapping": _median_m(mapped.run, truth),
        **_rivals(recording, echoes, nodes, known, truth, walk.seed, scratch),
    }
    return numbers | _asked(walk, mapped, encoder)


def _finetuned(file: Path, echoes: Echoes, scratch: ScratchParameters, seed: int) -> OnnxEncoder:
    """The pre-trained encoder, which then learnt the walk as one that hears it alone would."""
    from studies.paper_training import learnt_from_walk

    start = OnnxEncoder(file.read_bytes(), "as in the paper")
    gently = replace(scratch, learning_rate=FINETUNING_RATE)
    return learnt_from_walk(echoes, gently, seed=seed, start=start)


def _mapped(
    recording: Recording,
    echoes: Echoes,
    nodes: Odometry,
    encoder: Encoder,
    settings: Settings,
) -> Run:
    """A run by the paper's curation."""
    features = as_heard(echoes, encoder)
    alike = echo_sequence_similarity(features, nodes)
    closures = curated_closures(alike, nodes, CurationParameters())
    trajectory = optimise(build_graph(nodes, closures), nodes.t_s, settings.graph)
    floor_map = trajectory_map(
        trajectory, features, settings.floormap, parameters_digest=digest(settings),
        source=recording.name,
    )  # fmt: skip
    evidence = alike, closures, trajectory, floor_map, echoes, features
    return Run(recording.name, nodes, *evidence, {})


def as_heard(echoes: Echoes, encoder: Encoder) -> Features:
    """The features that the paper compares: nothing is taken from them."""
    return Features(echoes.t_s, encoder.embed(echoes.samples), encoder.identity)


def _rivals(
    recording: Recording,
    echoes: Echoes,
    nodes: Odometry,
    settings: Settings,
    truth: Truth,
    seed: int,
    scratch: ScratchParameters,
) -> Numbers:
    """The same walk by an encoder that heard it alone, and by plain spectrograms."""
    from studies.paper_training import learnt_from_walk

    rivals: Mapping[str, Encoder] = {
        "no pre-training": learnt_from_walk(echoes, scratch, seed=seed),
        "plain spectrogram": compared_encoders()[PLAIN],
    }
    return {
        f"mapping, {name}": _median_m(_mapped(recording, echoes, nodes, rival, settings), truth)
        for name, rival in rivals.items()
    }


def _median_m(run: Run, truth: Truth) -> float:
    return trajectory_errors(run.trajectory, truth)[MEDIAN_ALIGNED]


def _asked(walk: SimulatedWalk, mapped: Mapped, encoder: Encoder) -> Numbers:
    """Errors of another person's windows in the map, as usual and after every change."""
    world = load_world(walk.world)
    changes = {"one-shot": USUAL, **CHANGES, "opposite heading": USUAL}
    wanted = {name: today for name, today in changes.items() if walk.world in PAPER_M[name]}
    settings = replace(Settings(), locate=ALWAYS, segments=SEGMENTS)
    numbers: Numbers = {}
    for name, today in wanted.items():
        other = stranger(
            world, walk.seed, ROUNDS, encoder, circumstances=today,
            reverse=name == "opposite heading",
        )  # fmt: skip
        other = replace(other, features=as_heard(other.echoes, encoder))
        fixes = located(mapped, other, Mode.ONE_SHOT, settings)
        found = fix_numbers(fixes, other.truth, mapped.run.trajectory, mapped.truth)
        numbers[name] = found["mean" if name.endswith("mean") else "median"]
        if name == "one-shot":
            fixes = located(mapped, other, Mode.TRAJECTORY, settings)
            found = fix_numbers(fixes, other.truth, mapped.run.trajectory, mapped.truth)
            numbers["trajectory"] = found["median"]
    return numbers


def paper_rows(numbers: Mapping[str, Sequence[Numbers]]) -> list[Row]:
    """A row per world and figure; what the paper does not have has no ratio."""
    return [
        _row(world, name, [walk[name] for walk in walks])
        for world, walks in numbers.items()
        for name in walks[0]
    ]


def _row(world: str, name: str, found_m: Sequence[float]) -> Row:
    known_m = [value for value in found_m if np.isfinite(value)]
    ours_m, theirs_m = float(np.mean(known_m)), PAPER_M.get(name, {}).get(world)
    low, high = mean_interval(known_m)
    ratio = None if theirs_m is None else round(ours_m / theirs_m, 2)
    within = None if ratio is None else 1 / FACTOR <= ratio <= FACTOR
    return {
        "world": world, "figure": name, "ours (m)": round(ours_m, 3), "from": low, "to": high,
        "paper (m)": theirs_m, "ours over paper": ratio,
        "within a factor of two": within, "walks": len(known_m),
    }  # fmt: skip


def _page(rows: Sequence[Row]) -> Page:
    dots = dots_by(
        lambda row: str(row["world"]).replace("_", " "), lambda row: str(row["figure"]),
        rows, "ours (m)", "from", "to", "paper (m)",
    )  # fmt: skip
    panels = [Panel(world, _figure(world, some), NOTE) for world, some in dots.items()]
    panels.append(Panel("All figures", rows_table(rows), wide=True))
    return Page("The paper's recipe in a hard world", "its figures beside ours", panels)


def _figure(world: str, dots: Sequence[Dot]) -> go.Figure:
    """Ours beside the paper's, from centimetres to tens of metres."""
    figure = dots_figure({world: dots}, "error (m)", "the paper")
    figure.update_xaxes(type="log", tickvals=[0.1, 0.2, 0.5, 1, 2, 5, 10, 20])
    return figure
