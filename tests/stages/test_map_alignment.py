"""Placements are found by vote and believed on evidence alone."""

import dataclasses

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F32, F64
from elfslam.base.geometry import between, compose, inverse
from elfslam.base.values import Closures
from elfslam.stages import map_alignment
from elfslam.stages.map_alignment import WalkPair, align, resemblances, usual_resemblance

KNOWN = map_alignment.AlignmentParameters()
TRUE = np.array([4.0, -7.0, 2.5])
USUAL = 0.6


def ring(count: int = 60, radius_m: float = 5.0) -> F64:
    """Footsteps round a circle, anticlockwise."""
    angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.column_stack([radius_m * np.cos(angle), radius_m * np.sin(angle), angle + np.pi / 2])


def alike(one: F64, other: F64, height: float) -> F32:
    """Scores that fall with the distance of true poses."""
    apart = between(one[:, None], other[None])
    away = np.linalg.norm(apart[..., :2], axis=2) + np.abs(apart[..., 2])
    return np.asarray(height * np.exp(-away), dtype=np.float32)


def meeting(scores: F32, links: list[tuple[int, int]], poses: F64 | None = None) -> WalkPair:
    """Two rounds of the ring, the second in a frame of its own."""
    one = ring() if poses is None else poses
    i, j = np.array(links, dtype=np.int64).reshape(-1, 2).T
    none = np.zeros((len(i), 3))
    found = Closures(i, j, np.full(len(i), 0.5), none, np.tile(np.eye(3), (len(i), 1, 1)))
    return WalkPair(one, compose(inverse(TRUE), one), scores, found, 0.1)


def test_the_placement_that_all_votes_share_is_found() -> None:
    noise = np.random.default_rng(0).integers(0, 60, (30, 2)).tolist()
    links = [*((k, k) for k in range(60)), *noise]
    found = align(meeting(alike(ring(), ring(), USUAL), links), USUAL, KNOWN)
    assert found.refusal == ""
    npt.assert_allclose(found.one_from_other, TRUE, atol=0.05)
    assert found.resemblance == pytest.approx(1.0, abs=0.05)
    assert found.places > 25


def test_nothing_alike_is_no_placement() -> None:
    found = align(meeting(alike(ring(), ring(), USUAL), []), USUAL, KNOWN)
    assert found.refusal == "nothing sounds alike"


def test_a_little_common_ground_is_not_enough() -> None:
    short = ring()[:6]
    links = [(k, k) for k in range(6)]
    found = align(meeting(alike(short, short, USUAL), links, short), USUAL, KNOWN)
    assert "m2 in common" in found.refusal


def test_what_resembles_too_little_is_another_place() -> None:
    links = [(k, k) for k in range(60)]
    found = align(meeting(alike(ring(), ring(), 0.58 * USUAL), links), USUAL, KNOWN)
    assert found.refusal == "resembles no more than 58% of the usual"


def test_half_a_ring_that_resembles_little_more_is_no_evidence() -> None:
    """0.12 of the usual too much in each of 30 footsteps are 2.2, in each of 60 they are 4.3."""
    half, whole = (
        meeting(alike(part, part, 0.62 * USUAL), [(k, k) for k in range(len(part))], part)
        for part in (ring()[:30], ring())
    )
    found = align(half, USUAL, KNOWN)
    assert found.evidence == pytest.approx(30 * 0.12 * USUAL, rel=0.02)
    assert found.refusal == f"{found.places} m2 in common resemble it too little"
    assert align(whole, USUAL, KNOWN).refusal == ""


def test_a_ring_that_sounds_the_same_after_half_a_turn_has_no_certain_placement() -> None:
    """The two halves differ by noise alone."""
    generator = np.random.default_rng(1)
    one = ring()
    half = np.maximum(alike(one, one, USUAL), alike(one, np.roll(one, 30, axis=0), USUAL))
    links = [*[(k, k) for k in range(60)], *[(k, (k + 30) % 60) for k in range(60)]]
    doubtful = half + generator.normal(0, 0.05, half.shape).astype(np.float32)
    assert "fits nearly as well" in align(meeting(doubtful, links), USUAL, KNOWN).refusal
    clear = doubtful + 0.3 * alike(one, one, USUAL)
    found = align(meeting(clear, links), USUAL, KNOWN)
    assert found.refusal == ""
    assert np.isfinite(found.lead)
    npt.assert_allclose(found.one_from_other, TRUE, atol=0.05)


def test_a_rival_with_little_evidence_is_none() -> None:
    one = ring()
    part = np.where(np.arange(60) < 40, 1.0, 0.0)
    second = alike(one, np.roll(one, 30, axis=0), USUAL) * part
    scores = np.maximum(alike(one, one, USUAL), second).astype(np.float32)
    links = [*[(k, k) for k in range(60)], *[((k + 30) % 60, k) for k in range(40)]]
    assert align(meeting(scores, links), USUAL, KNOWN).lead == np.inf
    strict = dataclasses.replace(KNOWN, rival_share=0.0, least_lead=1e6)
    assert "fits nearly as well" in align(meeting(scores, links), USUAL, strict).refusal


def test_the_frame_of_either_side_does_not_matter() -> None:
    move = np.array([-30.0, 12.0, -2.0])
    links = [(k, k) for k in range(60)]
    plain = meeting(alike(ring(), ring(), USUAL), links)
    moved = dataclasses.replace(plain, one=compose(move, plain.one))
    first, second = (align(each, USUAL, KNOWN) for each in (plain, moved))
    npt.assert_allclose(second.one_from_other, compose(move, first.one_from_other), atol=1e-6)
    assert second.resemblance == pytest.approx(first.resemblance)


def test_only_neighbours_that_are_walked_the_same_way_are_compared() -> None:
    one = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, np.pi], [5.0, 0.0, 0.0]])
    scores = np.array([[0.2, 0.0], [0.9, 0.0], [0.9, 0.0]], dtype=np.float32)
    found = resemblances(one, np.array([[0.1, 0.0, 0.1], [20.0, 0.0, 0.0]]), scores, KNOWN)
    npt.assert_allclose(found, [0.2, np.nan], rtol=1e-6)


def test_a_walk_resembles_itself_where_it_comes_back() -> None:
    twice = np.vstack([ring(), ring()])
    scores = alike(twice, twice, 0.7)
    assert usual_resemblance(twice, scores, 12, KNOWN) == pytest.approx(0.7, abs=1e-5)
    assert usual_resemblance(ring()[:50], scores[:50, :50], 12, KNOWN) is None
