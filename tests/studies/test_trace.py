"""The trace of 58 markers: planted returns, and two rounds of the lab."""

import numpy as np
import pytest

from elfslam.base.geometry import wrap_angle
from elfslam.base.values import Echoes, Odometry
from elfslam.baselines.generic import generic_encoders
from elfslam.stages.feature import load_encoder
from elfslam.world.world_file import World, load_world
from studies import trace as study
from studies.study import StudyContext


def planted(rounds: int) -> np.ndarray:
    """Similarity 0.9 to the same marker, 0.95 to its neighbours, 0.1 elsewhere."""
    marker = np.arange(rounds * study.MARKERS) % study.MARKERS
    apart = np.abs(marker[:, None] - marker)
    apart = np.minimum(apart, study.MARKERS - apart)
    return np.select([apart == 0, apart <= 3], [0.9, 0.95], 0.1)


def test_planted_returns_are_all_on_top() -> None:
    found = study.returns_of(planted(4))
    assert found[study.RETURNS] == pytest.approx(np.full(study.MARKERS, 0.9))
    assert found[study.ELSEWHERE] == pytest.approx(np.full(study.MARKERS, 0.1))
    assert not found[study.HIGHER].any()
    assert (found[study.ON_TOP] == 100).all()


def test_one_higher_footstep_elsewhere_is_counted() -> None:
    scores = planted(4)
    scores[7, 30] = 0.99
    scores[9, 9] = 0.0  # a footstep itself is no return
    found = study.returns_of(scores)
    assert np.flatnonzero(found[study.HIGHER]).tolist() == [7]
    assert found[study.HIGHER][7] == pytest.approx(100 / (4 * (study.MARKERS - 7)))
    assert found[study.ON_TOP].sum() == 100 * (study.MARKERS - 1)
    assert found[study.RETURNS] == pytest.approx(np.full(study.MARKERS, 0.9))


def test_an_elf_stands_out_where_a_spectrum_does_not() -> None:
    encoders = {study.PSD: generic_encoders()["PSD"], "ELF": load_encoder("compact")}
    records = study.measure_trace(StudyContext(), encoders=encoders, rounds=2)
    found = {(each.method, each.metric, each.condition): each.value for each in records}
    assert found["ELF", study.HIGHER, ""] < 5
    assert found[study.PSD, study.HIGHER, ""] > 20
    ahead = {at: found[at, study.RETURNS, ""] - found[at, study.ELSEWHERE, ""] for at in encoders}
    assert ahead["ELF"] > 0.3 > ahead[study.PSD]
    far, near = (found["ELF", study.ESS, f"footsteps 0 and {k}"] for k in (58, 30))
    assert far > near + 0.3
    trace = {int(at): value for (name, metric, at), value in found.items()
             if name == "ELF" and metric == study.TRACE}  # fmt: skip
    assert (
        max(trace, key=lambda at: trace[at] if abs(at - study.FOOTSTEP) > 3 else 0)
        == 58 + study.FOOTSTEP
    )


def test_echoes_of_two_kinds_are_two_clouds() -> None:
    generator = np.random.default_rng(3)
    decay = np.exp(-np.arange(2352) / 400)
    kinds = generator.standard_normal((2, 2352)) * decay
    samples = np.repeat(kinds, 50, axis=0) + 0.01 * generator.standard_normal((100, 2352))
    plane = study.embedded(samples.astype(np.float32), 500)
    np.testing.assert_allclose(plane.mean(axis=0), 0.0, atol=1e-3)
    middles = plane[:50].mean(axis=0), plane[50:].mean(axis=0)
    spread = max(plane[:50].std(), plane[50:].std())
    assert np.linalg.norm(middles[0] - middles[1]) > 2 * spread


@pytest.fixture(scope="module")
def lab() -> World:
    return load_world("lab")


@pytest.fixture(scope="module")
def walked(lab: World) -> tuple[Odometry, Echoes]:
    return study.walk_over_markers(lab, 2, np.random.default_rng(0))


def test_markers_lie_evenly_and_look_ahead() -> None:
    markers = study.marker_poses()
    assert markers.shape == (study.MARKERS, 3)
    steps_m = np.linalg.norm(np.diff(markers[:, :2], axis=0), axis=1)
    assert np.median(steps_m) == pytest.approx(0.729, abs=0.001)
    assert steps_m.min() > 0.5, "shorter only where a corner is cut"
    np.testing.assert_allclose(markers[1:12, 2], 0.0, atol=1e-9)


def test_every_round_steps_on_every_marker(walked: tuple[Odometry, Echoes]) -> None:
    nodes, _ = walked
    assert len(nodes.t_s) == 2 * study.MARKERS + 1
    markers = np.vstack([np.tile(study.marker_poses(), (2, 1)), study.marker_poses()[:1]])
    off_m = nodes.world_from_body[:, :2] - markers[:, :2]
    assert 0.8 * study.FOOT_M < off_m.std() < 1.2 * study.FOOT_M
    turned = np.degrees(wrap_angle(nodes.world_from_body[:, 2] - markers[:, 2]))
    assert np.abs(turned).max() < 15
    assert np.abs(np.diff(nodes.world_from_body[:, 2])).max() < 1.2, "no jump by a full turn"
