"""Unknown phones in miniature."""

from __future__ import annotations

from typing import NoReturn

import pytest

from elfslam.world.circumstances import Circumstances
from elfslam.world.kinds import DAYS_LATER, MAPPING_PHONE, QUIET, SURVEYOR
from studies import unknown_phone
from studies.finding import Finding, Given
from studies.unknown_phone import Place, measure_unknown_phone


@pytest.fixture(scope="module")
def finding(tmp_path_factory: pytest.TempPathFactory) -> Finding:
    kept = tmp_path_factory.mktemp("phones") / "kept"
    return measure_unknown_phone(
        Given(kept=kept),
        worlds=["studio"], seeds=[110], phones=["bottom-fired"], rounds=1, steps=10,
        kind=QUIET,
    )  # fmt: skip


def test_each_map_is_asked_with_each_remedy(finding: Finding) -> None:
    asked = [(row["map"], row["phone is heard"]) for row in finding.rows]
    remedies = ("as it is", "translated")
    assert asked == [(name, done) for name in ("one way", "superimposed") for done in remedies]


def test_two_orientations_help_a_phone_that_hears_backward(finding: Finding) -> None:
    mean = {(row["map"], row["phone is heard"]): row["mean"] for row in finding.rows}
    assert mean["superimposed", "translated"] < 0.7 * mean["one way", "as it is"]  # type: ignore[operator]


def test_the_page_has_a_panel_for_the_world_and_the_table(finding: Finding) -> None:
    assert finding.page is not None
    assert [panel.title for panel in finding.page.panels] == ["In the studio", "In figures"]


def test_who_is_located_comes_later_and_with_the_phone(monkeypatch: pytest.MonkeyPatch) -> None:
    days: list[tuple[str, int]] = []

    def listen(*_: object, circumstances: Circumstances, **__: object) -> NoReturn:
        days.append((circumstances.device, circumstances.day))
        raise InterruptedError

    monkeypatch.setattr(unknown_phone, "simulate", listen)
    task = Place("studio", 110, SURVEYOR.name)
    for phone in (None, "cheap"):
        with pytest.raises(InterruptedError):
            unknown_phone._walk(task, 110, 1, phone=phone)
    assert days == [(MAPPING_PHONE, 0), ("cheap", DAYS_LATER)]
