"""The paper's own strategy in a hard world, beside the paper's own figures; or on one's own walk.

Echoes are compared by the compact network, which has heard one phone in simulated rooms and then
the walk that it maps. Loops are closed by the paper's curation from its threshold of 0.4, step
lengths are those of dead reckoning, and a window of 0.6 s is located at the most similar spot,
without feature mean normalisation: nothing of what this project adds. Laps are a surveyor's, the
sound is that of the diffuse engine, phones are ordinary ones, rooms are lived in. No constant was
fitted to these results.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from elfslam.app.settings import Settings
from elfslam.base.enums import Mode
from elfslam.base.errors import InputError
from elfslam.base.geometry import path_length_m
from elfslam.base.parameters import digest
from elfslam.base.values import (
    NO_CLOSURES,
    Echoes,
    Features,
    Odometry,
    Recording,
    Run,
    Trajectory,
    Truth,
)
from elfslam.data.recordings import read_recording
from elfslam.learn.parameters import PretrainParameters, ScratchParameters
from elfslam.scoring.truth import read_truth
from elfslam.slam.front_end import dead_reckoning_nodes
from elfslam.stages.closure import echo_sequence_similarity
from elfslam.stages.feature import Encoder, OnnxEncoder
from elfslam.stages.floormap import trajectory_map
from elfslam.stages.graph import build_graph, optimise
from elfslam.stages.segments import SegmentParameters
from elfslam.world.circumstances import Circumstances
from elfslam.world.kinds import ASKING_PHONE, MAPPING_PHONE, SURVEYOR
from elfslam.world.simulate import load_world
from studies.cached import SCENARIOS, SimulatedWalk, at_its_start, extract_echoes, simulate
from studies.curation import CurationParameters, curated_closures
from studies.located import (
    MAPPING_ROUNDS,
    MEDIAN_M,
    Mapped,
    Stranger,
    fix_numbers,
    located,
    stranger,
)
from studies.mapping import ALONE, CALIBRATED, trajectory_errors, walkers
from studies.plain_features import ALWAYS, PLAIN, compared_encoders
from studies.results import Record
from studies.study import MEDIAN_ALIGNED, Study, StudyContext, per_walk

WORLDS = ("living_room", "office", "mall")
SEEDS = tuple(range(5))
ROUNDS = 2
MEAN_M = "mean error (m)"
RECORDED = "recording"
"""The scenario of a walk of one's own."""
STRATEGY, RECKONED = "ELF, paper's strategy", "dead reckoning"
MAPPING, ONE_SHOT, TRAJECTORY = "mapping", "one-shot", "trajectory"
OPPOSITE, FURNITURE = "opposite heading", "furniture moved"
PAPER_M: Mapping[tuple[str, str], Mapping[str, float]] = {
    (STRATEGY, MAPPING): {"living_room": 0.10, "office": 0.63, "mall": 0.45},
    (ALONE, MAPPING): {"living_room": 0.73, "office": 1.69, "mall": 1.16},
    (STRATEGY, ONE_SHOT): {"living_room": 0.10, "office": 0.54, "mall": 0.42},
    (STRATEGY, TRAJECTORY): {"living_room": 0.10, "office": 0.41, "mall": 0.47},
    (STRATEGY, "volume 20 %"): {"living_room": 0.18, "office": 0.68, "mall": 0.56},
    (STRATEGY, "cheap phone"): {"living_room": 2.54},
    (STRATEGY, "another good phone"): {"living_room": 0.5},
    (STRATEGY, "8 people"): {"living_room": 0.6},
    (STRATEGY, FURNITURE): {"living_room": 1.3},
    (STRATEGY, "30 days later"): {"living_room": 0.12},
    (STRATEGY, OPPOSITE): {"living_room": 3.8},
}
"""By method and condition: medians in metres (the furniture's is a mean) in three real places."""
USUAL = Circumstances(engine="diffuse", device=MAPPING_PHONE, lived_in=True)
CHANGES: Mapping[str, Circumstances] = {
    "volume 20 %": replace(USUAL, volume=0.2),
    "cheap phone": replace(USUAL, device="cheap"),
    "another good phone": replace(USUAL, device=ASKING_PHONE),
    "8 people": replace(USUAL, people=8),
    FURNITURE: replace(USUAL, state="moved"),
    "30 days later": replace(USUAL, day=30),
}
SEGMENTS = replace(SegmentParameters(), unknown_below=0.58, temperature=0.015)
"""For features without mean normalisation, which are more similar to each other."""
FINETUNING_RATE = 2e-4
"""Peak learning rate of what has learnt before; the paper tells none."""


def measure_paper(
    context: StudyContext,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    rounds: int = MAPPING_ROUNDS,
    scratch: ScratchParameters | None = None,
    pretraining: PretrainParameters | None = None,
    recording: Path | None = None,
) -> list[Record]:
    """The paper's conditions in our worlds; or what its strategy makes of the recording named.

    The encoder that has heard no walk yet stays beside what is kept, by the digest of its recipe.
    """
    learning = scratch or ScratchParameters(threads=1)
    with _pretrained(context, pretraining) as file:
        if recording is not None:
            return measure_recording(recording, file, learning)
        measure = partial(_measured, file=file, scratch=learning)
        walks = per_walk(measure, context, worlds, seeds, rounds, SURVEYOR)
    return [replace(each, paper=paper_m(each)) for each in walks]


def measure_recording(folder: Path, file: Path, scratch: ScratchParameters) -> list[Record]:
    """What a walk becomes by the paper's strategy, and its errors where its truth is known.

    Raises InputError for a recording that cannot be read, or has no sound or too little of it.
    """
    recording, settings = read_recording(folder), Settings()
    echoes, nodes = extract_echoes(recording, settings), dead_reckoning_nodes(recording, settings)
    run = _mapped(recording, echoes, nodes, _finetuned(file, echoes, scratch, 0), settings)
    of = Record(STRATEGY, world=recording.name, scenario=RECORDED, condition=MAPPING)
    numbers = {
        "footsteps": len(nodes.t_s),
        "echoes": len(echoes.t_s),
        "closures": len(run.closures.i),
        "length (m)": path_length_m(run.trajectory.world_from_body[:, :2]),
    }
    records = of.each(numbers)
    with suppress(InputError):
        truth = read_truth(folder)
        reckoned = optimise(build_graph(nodes, NO_CLOSURES), nodes.t_s, settings.graph)
        for method, trajectory in ((STRATEGY, run.trajectory), (RECKONED, reckoned)):
            records += replace(of, method=method).each({MEDIAN_M: _median_m(trajectory, truth)})
    return records


@contextmanager
def _pretrained(context: StudyContext, pretraining: PretrainParameters | None) -> Iterator[Path]:
    """The file of the encoder that has heard no walk, trained where it is not there yet.

    It stays in the folder of what is kept; where nothing is, it passes.
    """
    from studies.paper_training import AS_IN_PAPER, pretrain_as_in_paper

    recipe = pretraining or AS_IN_PAPER
    with TemporaryDirectory() as passing:
        folder = Path(passing) if context.kept is None else context.kept.parent / "encoders"
        file = folder / f"as_in_paper_{digest(recipe)}.onnx"
        if not file.exists():
            pretrain_as_in_paper(file, recipe, context.announce)
        yield file


def _measured(walk: SimulatedWalk, file: Path, scratch: ScratchParameters) -> list[Record]:
    from studies.paper_training import learnt_from_walk

    world = load_world(walk.world)
    recording, truth = simulate(world, walk.seed, rounds=walk.rounds, circumstances=USUAL)
    recording = at_its_start(recording, truth)
    known, echoes = walkers(walk.seed, SURVEYOR)[CALIBRATED], extract_echoes(recording, Settings())
    nodes = dead_reckoning_nodes(recording, known)
    encoders: dict[str, Encoder] = {
        STRATEGY: _finetuned(file, echoes, scratch, walk.seed),
        ALONE: learnt_from_walk(echoes, scratch, seed=walk.seed),
        PLAIN: compared_encoders()[PLAIN],
    }
    runs = {name: _mapped(recording, echoes, nodes, each, known) for name, each in encoders.items()}
    of = partial(Record, world=walk.world, scenario=SCENARIOS[walk.kind])
    records = [
        of(name, MEDIAN_M, _median_m(run.trajectory, truth), condition=MAPPING)
        for name, run in runs.items()
    ]
    mapped = Mapped(recording, runs[STRATEGY], truth)
    return records + [
        of(STRATEGY, metric, value, condition=condition)
        for condition, metric, value in _queried(walk, mapped, encoders[STRATEGY])
    ]


def _finetuned(file: Path, echoes: Echoes, scratch: ScratchParameters, seed: int) -> OnnxEncoder:
    """The pre-trained encoder, which then learnt the walk as one that hears it alone would."""
    from studies.paper_training import learnt_from_walk

    start = OnnxEncoder(file.read_bytes(), "as in the paper")
    gently = replace(scratch, learning_rate=FINETUNING_RATE)
    return learnt_from_walk(echoes, gently, seed=seed, start=start)


def _mapped(
    recording: Recording, echoes: Echoes, nodes: Odometry, encoder: Encoder, settings: Settings
) -> Run:
    """A run by the paper's curation."""
    features = without_normalisation(echoes, encoder)
    similarity = echo_sequence_similarity(features, nodes)
    closures = curated_closures(similarity, nodes, CurationParameters())
    trajectory = optimise(build_graph(nodes, closures), nodes.t_s, settings.graph)
    floor_map = trajectory_map(
        trajectory, features, settings.floormap, parameters_digest=digest(settings),
        source=recording.name,
    )  # fmt: skip
    evidence = similarity, closures, trajectory, floor_map, echoes, features
    return Run(recording.name, nodes, *evidence, {})


def without_normalisation(echoes: Echoes, encoder: Encoder) -> Features:
    """The features that the paper compares: the mean over the walk stays in them."""
    return Features(echoes.t_s, encoder.embed(echoes.samples), encoder.identity)


def _median_m(trajectory: Trajectory, truth: Truth) -> float:
    return trajectory_errors(trajectory, truth)[MEDIAN_ALIGNED]


def _queried(
    walk: SimulatedWalk, mapped: Mapped, encoder: Encoder
) -> Iterator[tuple[str, str, float]]:
    """Condition, metric and error of another person's windows, as usual and after every change."""
    world = load_world(walk.world)
    changes = {ONE_SHOT: USUAL, **CHANGES, OPPOSITE: USUAL}
    settings = replace(Settings(), locate=ALWAYS, segments=SEGMENTS)

    def numbers(query: Stranger, mode: Mode) -> dict[str, float]:
        fixes = located(mapped, query, mode, settings)
        return fix_numbers(fixes, query.truth, mapped.run.trajectory, mapped.truth)

    for condition, today in changes.items():
        if walk.world not in PAPER_M[STRATEGY, condition]:
            continue
        query = stranger(
            world, walk.seed, ROUNDS, circumstances=today, reverse=condition == OPPOSITE
        )
        query = replace(query, features=without_normalisation(query.echoes, encoder))
        metric = MEAN_M if condition == FURNITURE else MEDIAN_M
        yield condition, metric, numbers(query, Mode.ONE_SHOT)[metric]
        if condition == ONE_SHOT:
            yield TRAJECTORY, MEDIAN_M, numbers(query, Mode.TRAJECTORY)[MEDIAN_M]


def paper_m(record: Record) -> float | None:
    """What the paper has for a record."""
    return PAPER_M.get((record.method, record.condition), {}).get(record.world)


STUDY = Study(
    "How far off is the paper's own strategy in our worlds, against the paper's figures?",
    measure_paper, minutes=60, long=True, recordings=True, needs=("torch", "sklearn"),
    fast={"worlds": ("living_room",), "seeds": (0,), "rounds": 2,
          "scratch": ScratchParameters(steps=10, pairs=32, threads=1),
          "pretraining": PretrainParameters(steps=2, pairs=32)},
)  # fmt: skip
