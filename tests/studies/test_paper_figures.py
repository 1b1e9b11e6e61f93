"""The data of the paper's pictures: where the chirp is, and that curation leaves the true pairs."""

import numpy as np

from elfslam.base.values import Similarity
from studies.cached import SimulatedWalk
from studies.curation import CurationParameters
from studies.paper_figures import (
    CANDIDATES,
    CORRELATION,
    CURATED,
    LATER,
    LEVEL_DB,
    RECKONED,
    SPOTS,
    TRUE,
    X_M,
    all_candidates,
    excitation,
    matrix,
    spectrograms,
    trajectories,
)
from studies.plain_features import ELF

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
    heard = {each.condition: each.value for each in records if each.metric == CORRELATION}
    assert float(max(heard, key=lambda at: heard[at]).split()[0]) < 2.0


def test_near_spots_look_more_alike_than_far_ones() -> None:
    records = list(spectrograms())
    one, near, far = (
        np.array([each.value for each in records if each.method == spot]) for spot in SPOTS
    )
    assert len(one) == 12 * 24
    assert {each.metric for each in records} == {LEVEL_DB}
    assert np.corrcoef(one, near)[0, 1] > np.corrcoef(one, far)[0, 1]


def test_every_pair_above_the_threshold_is_a_candidate_but_neighbours() -> None:
    scores = np.zeros((40, 40), dtype=np.float32)
    scores[3, 30] = scores[30, 3] = scores[3, 5] = 0.9
    found = all_candidates(Similarity(scores, "elf"), CurationParameters())
    assert (found.i.tolist(), found.j.tolist()) == ([3], [30])


def test_a_walk_is_drawn_by_every_method_and_its_matrix_curated() -> None:
    paths = list(trajectories(WALK))
    found = {each.method for each in paths}
    assert {TRUE, RECKONED, ELF} <= found
    x_m = {name: np.array([e.value for e in paths if (e.method, e.metric) == (name, X_M)])
           for name in (TRUE, ELF)}  # fmt: skip
    assert abs(np.ptp(x_m[ELF]) / np.ptp(x_m[TRUE]) - 1) < 0.1
    curated = list(matrix(WALK))
    drawn = [each.method for each in curated if each.metric == LATER]
    assert drawn.count(CURATED) > 0
    assert drawn.count(CANDIDATES) > 0
