"""The table of localization errors, small: echoes beat the baselines, and refuse another room."""

import pytest

from elfslam.world.kinds import SURVEYOR
from studies.localization import (
    ALWAYS_ANSWERED,
    ANSWERED_ELSEWHERE,
    ONE_SHOT,
    STUDY,
    TRACK,
    TRAJECTORY,
    measure_localization,
    paper_m,
)
from studies.located import MEDIAN_M
from studies.plain_features import PLAIN
from studies.results import Record
from studies.study import StudyContext

LEAST_ANSWERED = {ONE_SHOT: 0.6, TRAJECTORY: 0.8, TRACK: 0.9}


@pytest.fixture(scope="module")
def found() -> dict[tuple[str, str, str], float]:
    records = measure_localization(StudyContext(), kind=SURVEYOR, **STUDY.fast)
    return {(each.method, each.condition, each.metric): each.value for each in records}


def test_echoes_find_the_place_to_decimetres_and_wifi_does_not(
    found: dict[tuple[str, str, str], float],
) -> None:
    for way in LEAST_ANSWERED:
        assert found["ELF", way, MEDIAN_M] < 0.3
    for baseline in ("wifi", "wifi, paper's"):
        assert found[baseline, ONE_SHOT, MEDIAN_M] > 2 * found["ELF", ONE_SHOT, MEDIAN_M]


def test_answers_are_counted_here_and_in_another_room(
    found: dict[tuple[str, str, str], float],
) -> None:
    for way, least in LEAST_ANSWERED.items():
        assert found["ELF", way, "answered"] > least
        assert found["ELF", way, ANSWERED_ELSEWHERE] < 0.15
    assert found["magnetic", TRAJECTORY, "answered"] == 1.0
    assert found[ALWAYS_ANSWERED.format("log spectrogram"), ONE_SHOT, "answered"] > 0.95


def test_hand_made_features_go_through_the_particle_filter_too(
    found: dict[tuple[str, str, str], float],
) -> None:
    assert found[PLAIN, TRACK, "answered"] > 0.95
    assert found[PLAIN, TRACK, MEDIAN_M] < 0.5


def test_the_papers_figures_stand_beside_ours() -> None:
    def paper(condition: str, method: str = "ELF", metric: str = MEDIAN_M) -> float | None:
        return paper_m(Record(method, metric, 1.0, world="mall", condition=condition))

    assert (paper(ONE_SHOT), paper(TRAJECTORY)) == (0.42, 0.47)
    assert paper(ONE_SHOT, "wifi") is paper(TRACK) is paper(ONE_SHOT, metric="NEES") is None
