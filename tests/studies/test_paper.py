"""The paper's strategy, small: its errors stand beside the paper's, and it maps a recording."""

from pathlib import Path

import pytest

from elfslam.data.recordings import write_recording
from elfslam.learn.parameters import PretrainParameters, ScratchParameters
from elfslam.stages.feature import load_encoder
from elfslam.world.simulate import load_world, simulate
from studies import paper
from studies.paper import (
    MAPPING,
    OPPOSITE,
    PAPER_M,
    RECKONED,
    STRATEGY,
    USUAL,
    measure_paper,
)
from studies.study import StudyContext

QUICK = ScratchParameters(steps=2, pairs=16, threads=1)


def shipped_as_pretrained(file: Path, *_: object) -> None:
    """What is trained for an hour stands for what is trained for a quarter."""
    file.write_bytes(load_encoder("compact").content)


def test_a_recipe_is_trained_once_and_another_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trained: list[Path] = []

    def train(file: Path, *_: object) -> None:
        file.parent.mkdir(exist_ok=True)
        file.touch()
        trained.append(file)

    monkeypatch.setattr(paper, "per_walk", lambda *_: [])
    monkeypatch.setattr("studies.paper_training.pretrain_as_in_paper", train)
    context = StudyContext(kept=tmp_path / "paper.partial")
    for steps in (2, 2, 3):
        measure_paper(context, worlds=(), pretraining=PretrainParameters(steps=steps))
    assert len(trained) == len(set(trained)) == 2
    assert {file.parent for file in trained} == {tmp_path / "encoders"}


def test_the_opposite_heading_costs_what_nothing_else_does(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = {name: {"studio": 1.0} for name in PAPER_M if name[1] in {"one-shot", OPPOSITE}}
    asked |= {name: {} for name in PAPER_M if name not in asked}
    monkeypatch.setattr(paper, "PAPER_M", asked)
    monkeypatch.setattr("studies.paper_training.pretrain_as_in_paper", shipped_as_pretrained)
    records = measure_paper(
        StudyContext(), worlds=("studio",), seeds=(100,), rounds=3, scratch=QUICK
    )
    errors_m = {(each.method, each.condition): each.value for each in records}
    assert errors_m[STRATEGY, MAPPING] < 0.3
    assert errors_m[STRATEGY, OPPOSITE] > 5 * errors_m[STRATEGY, "one-shot"]
    papers = {each.condition: each.paper for each in records if each.method == STRATEGY}
    assert papers == {MAPPING: None, "one-shot": 1.0, "trajectory": None, OPPOSITE: 1.0}


def test_a_recording_of_ones_own_is_mapped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("studies.paper_training.pretrain_as_in_paper", shipped_as_pretrained)
    recording, truth = simulate(load_world("studio"), 100, rounds=3, circumstances=USUAL)
    walk = tmp_path / "walk"
    write_recording(recording, walk, truth=truth)
    known = measure_paper(StudyContext(), recording=walk, scratch=QUICK)
    errors_m = {each.method: each.value for each in known if each.metric == "median error (m)"}
    assert errors_m[STRATEGY] < errors_m[RECKONED]
    for file in walk.glob("truth.tum"):
        file.unlink()
    unknown = measure_paper(StudyContext(), recording=walk, scratch=QUICK)
    assert {each.metric for each in unknown} == {"footsteps", "echoes", "closures", "length (m)"}
