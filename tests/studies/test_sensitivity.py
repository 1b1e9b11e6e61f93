"""The sensitivity of localization, small: what changes is what was asked for."""

import numpy as np
import pytest

from elfslam.world.kinds import PEOPLE, QUIET
from elfslam.world.simulate import load_world
from studies import sensitivity
from studies.located import MEDIAN_M
from studies.study import StudyContext


def test_a_soft_phone_is_located_nearly_as_well(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sensitivity, "VOLUMES", (1.0, 0.2))
    records = sensitivity.measure_sensitivity(
        StudyContext(), places={"studio": "volume"}, seeds=(100,), mapping_rounds=2, rounds=1,
        kind=QUIET,
    )  # fmt: skip
    medians = {(r.condition, r.method): r.value for r in records if r.metric == MEDIAN_M}
    assert {condition for condition, _ in medians} == {"100 % volume", "20 % volume"}
    assert max(medians.values()) < 0.4
    answered = {r.method: r.value for r in records if r.metric == sensitivity.ANSWERED}
    assert answered["plain spectrogram, always answered"] == 1.0
    assert answered["ELF, always answered"] == 1.0


def test_every_change_is_asked_for_where_all_are() -> None:
    world = sensitivity.with_some_moved(load_world("living_room"))
    usual = PEOPLE.asking(world.room)
    changes = list(sensitivity.circumstances(world, "all", usual))
    asked = [condition for condition, _ in changes]
    assert all(today.engine == usual.engine for _, today in changes)
    assert len(asked) == len(set(asked))
    assert {f"{count} moved" for count in range(6)} <= set(asked)
    papers = {condition for *_, condition in sensitivity.PAPER_M} - {"0.6 s"}
    assert papers <= set(asked)


def test_pieces_are_moved_one_by_one() -> None:
    plain = load_world("studio")
    world = sensitivity.with_some_moved(plain)
    usual = plain.room.blocks
    for count in range(1, 6):
        blocks = world.states[f"moved {count}"].blocks
        away = [np.abs(a.centre_m - b.centre_m).max() for a, b in zip(usual, blocks, strict=True)]
        assert np.sum(np.array(away) > 0) == count
    last = world.states["moved 5"].blocks
    for block, moved in zip(plain.states["moved"].blocks, last, strict=True):
        np.testing.assert_allclose(block.centre_m, moved.centre_m)
    hall = load_world("concourse")
    assert set(sensitivity.with_some_moved(hall).states) >= set(hall.states)
