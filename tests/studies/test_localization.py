"""The table of localization errors, small: its counts, its thresholds, and what a fix costs."""

import numpy as np
import pytest

from elfslam.app.settings import Settings
from elfslam.base.enums import Mode
from elfslam.base.geometry import compose
from elfslam.base.values import Fixes, FixStatus, Odometry, Run, Trajectory, Truth
from elfslam.slam.pipeline import no_similarity
from elfslam.world.kinds import SURVEYOR
from studies import fix_thresholds, localization, localization_cost, thresholds
from studies.localization import ANSWERED_ELSEWHERE, ONE_SHOT, TRACK, TRAJECTORY, paper_m
from studies.located import MEDIAN_M, OVER_1_M, fix_numbers
from studies.mapping import NO_CLOSURES
from studies.plain_features import CLOSURE_THRESHOLDS, ELF, PLAIN, closing_by, compared_encoders
from studies.results import Record
from studies.study import StudyContext
from studies.thresholds import BEST, RATIO, _ratios, measure_thresholds

LEAST_ANSWERED = {ONE_SHOT: 0.6, TRAJECTORY: 0.8, TRACK: 0.9}


@pytest.fixture(scope="module")
def found() -> dict[tuple[str, str, str], float]:
    study = localization.STUDY
    records = study.measure(StudyContext(), kind=SURVEYOR, **study.fast)
    return {(each.method, each.condition, each.metric): each.value for each in records}


def test_echoes_find_the_place_to_decimetres_and_wifi_does_not(
    found: dict[tuple[str, str, str], float],
) -> None:
    for way in LEAST_ANSWERED:
        assert found["ELF", way, MEDIAN_M] < 0.3
    for baseline in ("wifi", "wifi, paper's"):
        assert found[baseline, ONE_SHOT, MEDIAN_M] > 2 * found["ELF", ONE_SHOT, MEDIAN_M]


def test_answers_are_counted_in_two_rooms(found: dict[tuple[str, str, str], float]) -> None:
    for way, least in LEAST_ANSWERED.items():
        assert found["ELF", way, "answered"] > least
        assert found["ELF", way, ANSWERED_ELSEWHERE] < 0.15
    assert found["magnetic", TRAJECTORY, "answered"] == 1.0
    always = localization.ALWAYS_ANSWERED.format("log spectrogram")
    assert found[always, ONE_SHOT, "answered"] > 0.95


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


def test_every_way_is_timed_and_memory_grows_with_the_map() -> None:
    study = localization_cost.STUDY
    records = study.measure(StudyContext(), **study.fast)
    assert all(each.value > 0 for each in records)
    small, large = (each.value for each in records if each.metric == localization_cost.MEMORY)
    assert large > 2 * small


def test_a_map_of_4000_spots_fits_in_four_megabytes() -> None:
    floor_map = localization_cost.grid_map(4000, np.random.default_rng(0))
    assert 4000 * 128 * 4 < localization_cost.map_bytes(floor_map) < 4e6
    steps_m = np.linalg.norm(np.diff(floor_map.xy_m, axis=0), axis=1)
    np.testing.assert_allclose(steps_m, 0.1)


T_S = np.arange(0.0, 10.0, 0.5)
TRUE = np.column_stack([T_S, 0.1 * T_S**2, np.zeros(len(T_S))])
MAP_FROM_WORLD = np.array([3.0, -2.0, 0.7])


def mapped() -> tuple[Run, Truth]:
    """A walk mapped without error, in axes of its own."""
    poses = compose(MAP_FROM_WORLD, TRUE)
    nodes = Odometry(T_S, poses, np.full((len(T_S) - 1, 3), 0.1))
    trajectory = Trajectory(T_S, poses, np.zeros((len(T_S), 3, 3)), np.empty(0), "OK")
    similarity = no_similarity(None, nodes)
    run = Run("walk", nodes, similarity, NO_CLOSURES, trajectory, None, None, None)
    return run, Truth(T_S, TRUE)


def fixes(off_m: float, sigma_m: float, refused: int) -> Fixes:
    """Fixes at the true places, off to one side; the first `refused` have no answer."""
    poses = compose(MAP_FROM_WORLD, TRUE + np.array([0.0, off_m, 0.0]))
    status = np.where(np.arange(len(T_S)) < refused, FixStatus.AMBIGUOUS, FixStatus.OK)
    covariance = np.tile(sigma_m**2 * np.eye(2), (len(T_S), 1, 1))
    return Fixes(T_S, poses[:, :2], poses[:, 2], covariance, np.ones(len(T_S)), status)


def test_errors_shares_and_sigmas() -> None:
    run, truth = mapped()
    found = fix_numbers(fixes(0.3, 0.15, refused=5), truth, run.trajectory, truth)
    assert found[MEDIAN_M] == pytest.approx(0.3)
    assert found["third quartile (m)"] == pytest.approx(0.3)
    assert found["NEES"] == pytest.approx(4.0)
    assert found["answered"] == pytest.approx(15 / 20)
    assert found[OVER_1_M] == 0.0
    assert fix_numbers(fixes(1.2, 0.15, refused=0), truth, run.trajectory, truth)[OVER_1_M] == 1.0


def test_no_answer_has_no_error() -> None:
    run, truth = mapped()
    found = fix_numbers(fixes(0.3, 0.15, refused=len(T_S)), truth, run.trajectory, truth)
    assert found["answered"] == 0.0
    assert np.isnan([found[MEDIAN_M], found[OVER_1_M], found["NEES"]]).all()


def test_higher_thresholds_answer_less(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fix_thresholds, "UNKNOWN_BELOW", (0.4, 0.6, 0.78))
    monkeypatch.setattr(fix_thresholds, "KINDS", ("quiet",))
    records = fix_thresholds.measure_fix_thresholds(StudyContext(), **fix_thresholds.STUDY.fast)
    for mode in Mode:
        for metric in ("answered", ANSWERED_ELSEWHERE):
            shares = [
                each.value for each in records
                if (each.method, each.metric) == (mode.value, metric)
            ]  # fmt: skip
            assert len(shares) == 3
            assert shares == sorted(shares, reverse=True)


def planted(feature: str, **ratios: float) -> list[Record]:
    return [Record(feature, RATIO, value, condition=name[1:]) for name, value in ratios.items()]


def test_the_best_threshold_has_the_least_geometric_mean() -> None:
    walks = [
        [*planted("a", _1=0.5, _2=0.2), *planted("b", _1=0.9, _2=1.0)],
        [*planted("a", _1=0.5, _2=0.4), *planted("b", _1=0.1, _2=0.2)],
    ]
    found = _ratios(walks, (0, 1))
    ratios = [each.value for each in found if each.metric == RATIO]
    assert ratios == pytest.approx([0.5, 0.283, 0.3, 0.447], abs=1e-3)
    assert {each.method: each.value for each in found if each.metric == BEST} == {"a": 2, "b": 1}


def test_the_elf_closes_as_the_pipeline_does_by_itself() -> None:
    assert set(CLOSURE_THRESHOLDS) == set(compared_encoders())
    assert closing_by(ELF, Settings()) == Settings().closure


def test_a_prior_lowers_the_threshold_of_each_feature_by_the_same_share() -> None:
    for feature, threshold in CLOSURE_THRESHOLDS.items():
        closing, elf = closing_by(feature, Settings()), Settings().closure
        assert closing.threshold == threshold
        lowered, by_elf = (4.0 / (each.score_evidence * each.threshold) for each in (closing, elf))
        assert lowered == pytest.approx(by_elf)
        fall, of_elf = (each.sigma_fall * each.threshold for each in (closing, elf))
        assert fall == pytest.approx(of_elf)


def test_closures_help_at_the_best_threshold() -> None:
    records = measure_thresholds(StudyContext(), **thresholds.STUDY.fast)
    ratios = [r.value for r in records if (r.method, r.metric) == (ELF, RATIO)]
    assert len(ratios) == len(thresholds.STUDY.fast["thresholds"])
    assert min(ratios) < 0.7
