"""Closures step by step, guided, in published graphs, and by how much training takes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from elfslam.app import simulated_training as pretraining
from elfslam.base.values import silent
from elfslam.data.map_exports import read_g2o
from elfslam.learn.parameters import PretrainParameters
from elfslam.world.kinds import PEOPLE, QUIET
from studies import amounts, closures, guided_matching, pose_graphs
from studies.amounts import FINETUNED, LOSS, PRETRAINED, RECALL, STARTS, TrainedWalk
from studies.cached import SimulatedWalk
from studies.guided_matching import ALL_WORLDS, EQUAL, GUIDED, RATIO, WEIGHED, _logarithms, _ratio
from studies.plain_features import ELF, PLAIN
from studies.results import Record, averaged
from studies.study import MEDIAN_ALIGNED, StudyContext


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return closures.measure_closures(StudyContext(), kind=QUIET, **closures.STUDY.fast)


def value(records: list[Record], method: str, condition: str, metric: str) -> float:
    wanted = (method, condition, metric)
    [found] = [r.value for r in records if (r.method, r.condition, r.metric) == wanted]
    return found


def test_every_step_leaves_less_and_is_more_right(records: list[Record]) -> None:
    steps = ("ridges", "within the gate", "ratio test passed", closures.ACCEPTED)
    recall, precision = (
        [value(records, closures.SEQUENCE, step, metric) for step in steps]
        for metric in ("recall", "precision")
    )
    assert recall == sorted(recall, reverse=True)
    assert precision == sorted(precision)
    assert precision[-1] > 0.9


def test_symmetry_drops_some_of_what_lies_on_lines(records: list[Record]) -> None:
    on_lines = value(records, closures.PAPER, "on a line in its slice", "recall")
    assert 0 < value(records, closures.PAPER, "symmetric, one per line", "recall") < on_lines


def test_sequences_may_be_accepted_whole_and_nearest_neighbours_not(records: list[Record]) -> None:
    sequences, nearest = (
        value(records, method, closures.ACCEPTED, closures.MEDIAN_BELIEVED)
        for method in (closures.SEQUENCE, closures.NEAREST)
    )
    assert sequences < nearest


def walk(world: str, before_m: float, after_m: float) -> list[Record]:
    numbers = {WEIGHED: {MEDIAN_ALIGNED: before_m}, GUIDED: {MEDIAN_ALIGNED: after_m}}
    return list(_logarithms(SimulatedWalk(world, 120, 4, PEOPLE.name), ELF, numbers))


def test_ratios_are_geometric_means_of_each_world_and_of_all() -> None:
    walks = [walk("studio", 0.2, 0.1), walk("studio", 0.2, 0.4), walk("hall", 1.0, 0.125)]
    found = [_ratio(each) for each in averaged(walks, (120, 121))]
    wanted = {"studio": 1.0, "hall": 0.125, ALL_WORLDS: 0.5}
    assert {each.world: each.value for each in found} == pytest.approx(wanted)
    (pooled,) = [each for each in found if each.world == ALL_WORLDS]
    assert pooled.low == pytest.approx(0.125)
    assert pooled.high == pytest.approx(2.0)
    assert {each.condition for each in found} == {GUIDED}


def guided(records: Sequence[Record], method: str, condition: str, metric: str) -> float:
    (found,) = [
        each.value
        for each in records
        if (each.method, each.condition, each.metric) == (method, condition, metric)
        and each.world != ALL_WORLDS
    ]
    return found


def test_a_first_solution_leads_to_further_returns_by_every_feature() -> None:
    records = guided_matching.measure_guided_matching(
        StudyContext(), kind=PEOPLE, **guided_matching.STUDY.fast
    )
    for feature in (ELF, PLAIN):
        before, after = (guided(records, feature, each, "recall") for each in (WEIGHED, GUIDED))
        assert before <= after
        error_m = [guided(records, feature, each, MEDIAN_ALIGNED) for each in (WEIGHED, EQUAL)]
        ratio = guided(records, feature, EQUAL, RATIO)
        assert ratio == pytest.approx(error_m[1] / error_m[0])
    assert np.isfinite(guided(records, "magnetic", GUIDED, RATIO))


def test_false_closures_do_not_move_the_answer(shared_data: Path) -> None:
    records = pose_graphs.measure_pose_graphs(StudyContext(shared_data), **pose_graphs.STUDY.fast)
    found = {(r.method, r.world, r.condition, r.metric): r for r in records}
    for name in ("ring", "MIT"):
        ours = found[pose_graphs.OURS, name, "", pose_graphs.COST]
        assert ours.value == pytest.approx(ours.paper, rel=1e-3)
    assert (
        found[pose_graphs.PLAIN_LM, "MIT", "", pose_graphs.COST].value
        > 10 * found[pose_graphs.OURS, "MIT", "", pose_graphs.COST].value
    )
    clean = found[pose_graphs.PLAIN_LM, "ring", "0 % false closures", pose_graphs.RMSE].value
    for condition in (f"{share} % false closures" for share in (10, 30, 50)):
        ours = found[pose_graphs.OURS, "ring", condition, pose_graphs.WORST]
        assert ours.value == pytest.approx(clean, rel=0.1)
        assert found[pose_graphs.PLAIN_LM, "ring", condition, pose_graphs.RMSE].value > 2 * clean


def test_what_is_injected_says_that_random_poses_are_one(shared_data: Path) -> None:
    graph = read_g2o(shared_data / "pose_graphs" / "ring.g2o")
    attacked = pose_graphs.injected(graph, 0.5, 7)
    assert len(attacked.edges) - len(graph.edges) == 13
    false = attacked.edges[-13:]
    assert (np.abs(false[:, 0] - false[:, 1]) > 1).all()
    assert (attacked.measurements[-13:] == 0).all()
    assert attacked.is_closure[-13:].all()
    np.testing.assert_array_equal(pose_graphs.injected(graph, 0.5, 7).edges, attacked.edges)
    assert (pose_graphs.injected(graph, 0.5, 8).edges[-13:] != false).any()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("amounts")


@pytest.fixture(scope="module")
def found(folder: Path) -> list[Record]:
    context = StudyContext(kept=folder / "amounts.partial")
    return list(amounts.STUDY.measure(context, **amounts.STUDY.fast))


def test_one_batch_teaches_little(found: list[Record]) -> None:
    value = {each.metric: each.value for each in found if each.method == PRETRAINED}
    assert 0.0 < value[MEDIAN_ALIGNED] < 3.0
    assert 0.0 <= value[RECALL] < 0.8


def test_the_loss_begins_lower_from_what_was_trained(found: list[Record]) -> None:
    losses = [each for each in found if each.metric == LOSS]
    fresh, trained = ([at.value for at in losses if at.method == start] for start in STARTS)
    assert len(fresh) == len(trained) == 2
    assert np.mean(trained) < np.mean(fresh)


def test_an_encoder_is_trained_once(
    found: list[Record], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert found
    monkeypatch.setattr(pretraining, "pretrain_on_simulated_echoes", None)
    again = amounts._trained(512, folder / "encoders", PretrainParameters(), silent)
    assert again.content == (folder / "encoders" / "512.onnx").read_bytes()


def test_fine_tuning_learns_from_the_first_minutes_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    given = []

    def listen(encoder, echoes, known, seed, announce):
        given.append(echoes)
        raise InterruptedError

    monkeypatch.setattr(amounts, "finetuned", listen)
    walk = TrainedWalk(FINETUNED, 0.5, SimulatedWalk("studio", 100, 2))
    with pytest.raises(InterruptedError):
        amounts._measured(walk, lambda echoes: None)
    assert 29.0 < np.ptp(given[0].t_s) <= 30.0
