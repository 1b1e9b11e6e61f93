"""The sensitivity of localization, small: what changes is what was asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.scoring.page import save_page
from elfslam.world.kinds import PEOPLE, QUIET
from elfslam.world.simulate import load_world
from studies import sensitivity
from studies.finding import Finding, Given
from studies.plain_features import ELF, PLAIN
from studies.sensitivity import measure_sensitivity, with_some_moved
from studies.sensitivity_table import MODES, sensitivity_page


@pytest.fixture(scope="module")
def finding() -> Finding:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sensitivity, "VOLUMES", (1.0, 0.2))
        small = {"places": {"studio": "volume"}, "seeds": (100,), "mapping_rounds": 2, "rounds": 1}
        return measure_sensitivity(Given(), kind=QUIET, **small)


def test_a_soft_phone_is_located_nearly_as_well(finding: Finding) -> None:
    medians = {(row["amount"], row["mode"]): row["median (m)"] for row in finding.rows}
    assert set(medians) == {(amount, mode) for amount in ("1", "0.2") for mode in MODES}
    assert max(float(str(value)) for value in medians.values()) < 0.4
    answered = {(row["amount"], row["mode"]): row["answered"] for row in finding.rows}
    assert {answered[amount, feature] for amount in ("1", "0.2") for feature in (PLAIN, ELF)} == {
        1.0
    }


def test_every_change_is_asked_for_where_all_are() -> None:
    world = with_some_moved(load_world("studio"))
    usual = PEOPLE.asking(world.room)
    changes = list(sensitivity._circumstances(world, "all", usual))
    asked = [(change, amount) for change, amount, _ in changes]
    assert all(today.engine == usual.engine for _, _, today in changes)
    assert len(asked) == len(set(asked))
    assert {change for change, _ in asked} == {
        "volume", "people", "day", "sound", "moved", "phone",
    }  # fmt: skip
    assert [amount for change, amount in asked if change == "moved"] == list("012345")


def test_pieces_are_moved_one_by_one() -> None:
    plain = load_world("studio")
    world = with_some_moved(plain)
    usual = plain.room.blocks
    for count in range(1, 6):
        blocks = world.states[f"moved {count}"].blocks
        away = [np.abs(a.centre_m - b.centre_m).max() for a, b in zip(usual, blocks, strict=True)]
        assert np.sum(np.array(away) > 0) == count
    last = world.states["moved 5"].blocks
    for block, moved in zip(plain.states["moved"].blocks, last, strict=True):
        np.testing.assert_allclose(block.centre_m, moved.centre_m)
    hall = load_world("concourse")
    assert set(with_some_moved(hall).states) >= set(hall.states)


def test_the_page_draws_amounts_as_curves_and_names_as_dots(tmp_path: Path) -> None:
    found = {"median (m)": 0.1, "mean (m)": 0.1, "Q3 (m)": 0.2, "median from": 0.05,
             "median to": 0.2, "answered": 1.0, "ambiguous": 0.0, "over 1 m off": 0.0,
             "walks": 2}  # fmt: skip
    rows = [
        {"world": "living_room", "change": change, "amount": amount, "mode": "one-shot", **found}
        for change, amount in (("people", "8"), ("people", "0"), ("phone", "cheap"))
    ]
    rows.append({**rows[-1], "amount": "deaf", "median (m)": None, "median from": None})
    page = sensitivity_page(rows)
    save_page(tmp_path / "page.html", page)
    assert [panel.title.split(",")[0] for panel in page.panels] == [
        "People walking about", "Answered", "Another phone", "Every amount",
    ]  # fmt: skip
    names = [trace.name for trace in page.panels[0].body.data]  # type: ignore[union-attr]
    assert "the paper, one-shot" in names
