"""The paper's strategy, training and pictures in small, and the summary of its page."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_SAMPLES, Echoes, Similarity
from elfslam.data.recordings import write_recording
from elfslam.learn.parameters import PretrainParameters, ScratchParameters
from elfslam.stages.feature import OnnxEncoder, load_encoder
from elfslam.world.simulate import load_world, simulate
from studies import paper, paper_figures, paper_summary
from studies.cached import SimulatedWalk
from studies.curation import CurationParameters
from studies.paper_figures import CURATED, LATER, LEVEL_DB, SPOTS, TRUE, X_M, excitation, matrix
from studies.paper_summary import ALL, CLOSER, OTHER, PARTS, WITHOUT, Part, measure_paper_summary
from studies.paper_training import learnt_from_walk
from studies.plain_features import ELF
from studies.results import RESULTS, ROOT, Record, read_results, stamped, write_results
from studies.study import StudyContext

QUICK = ScratchParameters(steps=2, pairs=16, threads=1)


def shipped_as_pretrained(file: Path, *_: object) -> None:
    """What is trained for an hour stands for what is trained for a quarter."""
    file.write_bytes(load_encoder("compact").content)


def test_a_recipe_is_trained_once_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trained: list[Path] = []

    def train(file: Path, *_: object) -> None:
        file.parent.mkdir(exist_ok=True)
        file.touch()
        trained.append(file)

    monkeypatch.setattr(paper, "per_walk", lambda *_: [])
    monkeypatch.setattr("studies.paper_training.pretrain_as_in_paper", train)
    context = StudyContext(kept=tmp_path / "paper.partial")
    for steps in (2, 2, 3):
        paper.measure_paper(context, worlds=(), pretraining=PretrainParameters(steps=steps))
    assert len(trained) == len(set(trained)) == 2
    assert {file.parent for file in trained} == {tmp_path / "encoders"}


def test_the_opposite_heading_costs_what_nothing_else_does(monkeypatch: pytest.MonkeyPatch) -> None:
    turned = {"one-shot", paper.OPPOSITE}
    asked = {name: {"studio": 1.0} for name in paper.PAPER_M if name[1] in turned}
    asked |= {name: {} for name in paper.PAPER_M if name not in asked}
    monkeypatch.setattr(paper, "PAPER_M", asked)
    monkeypatch.setattr("studies.paper_training.pretrain_as_in_paper", shipped_as_pretrained)
    how = {"worlds": ("studio",), "seeds": (100,), "rounds": 3}
    records = paper.measure_paper(StudyContext(), scratch=QUICK, **how)
    errors_m = {(each.method, each.condition): each.value for each in records}
    assert errors_m[paper.STRATEGY, paper.MAPPING] < 0.3
    assert errors_m[paper.STRATEGY, paper.OPPOSITE] > 5 * errors_m[paper.STRATEGY, "one-shot"]
    papers = {each.condition: each.paper for each in records if each.method == paper.STRATEGY}
    assert papers == {paper.MAPPING: None, "one-shot": 1.0, "trajectory": None, paper.OPPOSITE: 1.0}


def test_a_recording_of_ones_own_is_mapped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("studies.paper_training.pretrain_as_in_paper", shipped_as_pretrained)
    recording, truth = simulate(load_world("studio"), 100, rounds=3, circumstances=paper.USUAL)
    walk = tmp_path / "walk"
    write_recording(recording, walk, truth=truth)
    known = paper.measure_paper(StudyContext(), recording=walk, scratch=QUICK)
    errors_m = {each.method: each.value for each in known if each.metric == "median error (m)"}
    assert errors_m[paper.STRATEGY] < errors_m[paper.RECKONED]
    for file in walk.glob("truth.tum"):
        file.unlink()
    unknown = paper.measure_paper(StudyContext(), recording=walk, scratch=QUICK)
    assert {each.metric for each in unknown} == {"footsteps", "echoes", "closures", "length (m)"}


def test_errors_are_counted_by_side_and_other_numbers_apart(tmp_path: Path) -> None:
    records = [
        Record("ELF", "median error (m)", 0.1, paper=0.2, world="mall", condition="2 people"),
        Record("ELF", "median error (m)", 0.3, paper=0.2, world="mall", condition="4 people"),
        Record("ELF", "recognised", 0.9, paper=0.8, world="mall", condition="6 people"),
        Record("ELF", "median error (m)", 0.1, paper=0.2, world="office", condition="2 people"),
        Record("ELF", "median error (m)", 0.3, world="mall", condition="8 people"),
    ]
    write_results(tmp_path / "a.csv", stamped("a", records, "12345678", "2026-01-01"))
    parts = (
        Part("People", "a", {"world": "mall", "condition": "* people"}),
        Part("Another", "a", {"condition": "nothing"}),
        Part("No file", "b"),
        Part("No study"),
    )
    found = measure_paper_summary(StudyContext(), results=tmp_path, parts=parts)
    whole = {each.metric: each.value for each in found if each.method == ALL}
    of = [paper_summary.PARTS_OF, paper_summary.WITH_OURS, WITHOUT]
    assert [whole[each] for each in of] == [4, 1, 3]
    of = [paper_summary.COMPARED, CLOSER, paper_summary.FARTHER, OTHER]
    assert [whole[each] for each in of] == [3, 1, 1, 1]


def test_the_summary_is_of_the_results_that_stand() -> None:
    kept = {(e.method, e.metric): e.value for e in read_results(RESULTS / "paper-summary.csv")}
    now = {(e.method, e.metric): e.value for e in measure_paper_summary(StudyContext())}
    assert kept == now, "run `python -m studies paper-summary`, then render"


def test_the_page_has_every_part() -> None:
    page = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    figures = {part.name.split(":")[0].rstrip("abc") for part in PARTS if ":" in part.name}
    missing = [
        name for name in figures
        if name not in page and name.replace("Figure ", "") not in page
    ]  # fmt: skip
    assert not missing


WALK = SimulatedWalk("studio", 100, 3, "surveyor")


def test_the_chirp_rises_through_its_band_and_is_found_where_it_arrives() -> None:
    records = list(excitation())
    loudest: dict[float, tuple[float, float]] = {}
    for each in records:
        if each.method == "chirp" and each.value > -10:
            at_ms, _, khz, _ = each.condition.replace(",", "").split()
            found = (each.value, float(khz))
            loudest[float(at_ms)] = max(found, loudest.get(float(at_ms), found))
    khz_by_time = [loudest[at_ms][1] for at_ms in sorted(loudest)]
    assert khz_by_time == sorted(khz_by_time)
    assert khz_by_time[0] < 16
    assert khz_by_time[-1] > 19
    known = [each for each in records if each.metric == paper_figures.CORRELATION]
    heard = {each.condition: each.value for each in known}
    assert float(max(heard, key=lambda at: heard[at]).split()[0]) < 2.0


def test_near_spots_look_more_alike_than_far_ones() -> None:
    records = list(paper_figures.spectrograms())
    one, near, far = (np.array([at.value for at in records if at.method == spot]) for spot in SPOTS)
    assert len(one) == 12 * 24
    assert {each.metric for each in records} == {LEVEL_DB}
    assert np.corrcoef(one, near)[0, 1] > np.corrcoef(one, far)[0, 1]


def test_every_pair_above_the_threshold_is_a_candidate_but_neighbours() -> None:
    scores = np.zeros((40, 40), dtype=np.float32)
    scores[3, 30] = scores[30, 3] = scores[3, 5] = 0.9
    found = paper_figures.all_candidates(Similarity(scores, "elf"), CurationParameters())
    assert (found.i.tolist(), found.j.tolist()) == ([3], [30])


def test_a_walk_is_drawn_by_every_method_and_its_matrix_curated() -> None:
    paths = list(paper_figures.trajectories(WALK))
    found = {each.method for each in paths}
    assert {TRUE, paper_figures.RECKONED, ELF} <= found
    x_m = {name: np.array([e.value for e in paths if (e.method, e.metric) == (name, X_M)])
           for name in (TRUE, ELF)}  # fmt: skip
    assert abs(np.ptp(x_m[ELF]) / np.ptp(x_m[TRUE]) - 1) < 0.1
    curated = list(matrix(WALK))
    drawn = [each.method for each in curated if each.metric == LATER]
    assert drawn.count(CURATED) > 0
    assert drawn.count(paper_figures.CANDIDATES) > 0


FEW = replace(ScratchParameters(), steps=40, pairs=32, near_s=1.0, threads=1)


def passing(stretches: int, each: int) -> Echoes:
    """A walk past `stretches` places of their own sound, with noise on every echo."""
    generator = np.random.default_rng(0)
    sound = generator.standard_normal((stretches, ECHO_SAMPLES)).astype(np.float32)
    samples = np.repeat(sound, each, axis=0)
    samples += 0.5 * generator.standard_normal(samples.shape, dtype=np.float32)
    count = len(samples)
    return Echoes(0.1 * np.arange(count), samples, np.zeros((0, 2)))


@pytest.fixture(scope="module")
def walk() -> Echoes:
    return passing(8, 12)


@pytest.fixture(scope="module")
def learnt(walk: Echoes) -> OnnxEncoder:
    return learnt_from_walk(walk, FEW, seed=1, width=8)


def test_it_tells_the_stretches_apart(walk: Echoes, learnt: OnnxEncoder) -> None:
    rows = learnt.embed(walk.samples)
    place = np.arange(len(rows)) // 12
    cosine, same = rows @ rows.T, place[:, None] == place
    np.fill_diagonal(same, False)
    apart = place[:, None] != place
    assert cosine[same].mean() > cosine[apart].mean() + 0.2


def test_a_seed_gives_one_encoder(walk: Echoes, learnt: OnnxEncoder) -> None:
    assert learnt_from_walk(walk, FEW, seed=1, width=8).content == learnt.content
    assert learnt_from_walk(walk, FEW, seed=2, width=8).content != learnt.content


def test_too_few_echoes_are_refused() -> None:
    with pytest.raises(InputError, match="wanted 32 consecutive echoes, got 19; walk longer"):
        learnt_from_walk(passing(2, 10), FEW, seed=0, width=8)


def test_a_start_is_where_it_begins(walk: Echoes, learnt: OnnxEncoder) -> None:
    """Without steps the start comes out; with them, its first loss is that of what was learnt."""
    none = replace(FEW, steps=0)
    same = learnt_from_walk(walk, none, seed=5, start=learnt)
    np.testing.assert_allclose(same.embed(walk.samples), learnt.embed(walk.samples), atol=1e-5)
    fresh: list[float] = []
    going_on: list[float] = []
    learnt_from_walk(walk, FEW, seed=1, width=8, report=fresh.append)
    learnt_from_walk(walk, FEW, seed=1, start=learnt, report=going_on.append)
    assert len(fresh) == len(going_on) == FEW.steps
    assert going_on[0] < 0.8 * fresh[0]
    assert fresh[-1] < fresh[0]


def test_the_statistics_of_a_start_stay(walk: Echoes, learnt: OnnxEncoder) -> None:
    """Where nothing is learnt nothing changes: its norms do not take on those of the walk."""
    idle = replace(FEW, steps=5, learning_rate=1e-9)
    same = learnt_from_walk(walk, idle, seed=5, start=learnt)
    np.testing.assert_allclose(same.embed(walk.samples), learnt.embed(walk.samples), atol=1e-4)
