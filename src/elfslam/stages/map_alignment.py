"""Relative pose of two maps by voting over matched places, accepted by a ratio test.

Each pair of places that sound alike votes for a placement. The placements that the votes gather
around are judged as a whole: wherever the walks then cover the same ground they must be nearly as
similar as each is to itself, over enough ground; and no other placement may do as well.
That is what tells a place from its mirror image, and one room from another like it.
"""

# mypy takes every call on the right of a field for a default.
# mypy: disable-error-code="misc"

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from elfslam.base.arrays import C128, F32, F64, I64, Bool, Value, array
from elfslam.base.geometry import compose, inverse, wrap_angle
from elfslam.base.parameters import parameter
from elfslam.base.values import Closures

AHEAD_M = 1.0
"""A pose counts as two points, itself and one this far ahead: so that headings have a say."""
REACH_M = (2.0, 1.5, 1.0, 0.8, 0.8, 0.8)
"""How far from a placement its votes may lie, round after round of moving it to their mean."""
NEIGHBOURS = 64
"""Most footsteps that one is compared with."""
FEWEST_PLACES = 3
"""Of fewer square metres nobody can say how much their differences vary."""


@dataclass(frozen=True)
class AlignmentParameters:
    """When walks of unknown starts are believed to lie in one frame."""

    short_sequence: int = parameter(
        2, "footsteps", "averaged before and after a footstep to judge a placement", 0, 50
    )
    near_m: float = parameter(0.6, "m", "footsteps this close should sound alike", 0.05, 10.0)
    turn_rad: float = parameter(
        0.6, "rad", "and only those that are walked within this angle", 0.05, 3.2
    )
    placements: int = parameter(120, "", "votes that are followed up", 1, 10_000)
    votes: int = parameter(6000, "", "the strongest votes that are heard", 10, 10**6)
    least_places: int = parameter(
        6, "m2", "ground that both must cover in the same direction", 3, 10_000
    )
    least_resemblance: float = parameter(
        0.6, "", "resemblance there, relative to that of a walk to itself", 0.0, 2.0
    )
    least_evidence: float = parameter(
        2.5, "", "resemblance beyond half the usual, summed over the footsteps there", 0.0, 1000.0
    )
    usual_resemblance: float = parameter(
        0.5, "", "that of a walk to itself, where it never comes back", 0.01, 1.0
    )
    rival_m: float = parameter(1.5, "m", "a placement this far off is another one", 0.1, 100.0)
    least_lead: float = parameter(
        2.5, "sigma", "by how much the best must beat any competing one, place by place", 0, 100
    )
    rival_share: float = parameter(
        0.5, "", "with less than this share of the best's evidence it does not compete", 0.0, 1.0
    )


@dataclass(frozen=True, eq=False)
class WalkPair(Value):
    """Footsteps of walks that share a frame (n), those of one more (m), and how similar they are.

    The links sound alike over a long sequence: footsteps i of the one and j of the other, in any
    order. `sigma_m` says how far either side may be bent. A score of minus infinity does not count.
    """

    one: F64 = array("n", 3)
    other: F64 = array("m", 3)
    scores: F32 = array("n", "m", dtype=np.float32, finite=False, largest=np.inf)
    links: Closures
    sigma_m: float


@dataclass(frozen=True, eq=False)
class Registration(Value):
    """The best placement, the evidence for it, and why it is not believed ("" where it is).

    `evidence` sums the similarity over footsteps, `lead` is in standard errors (infinite without
    a competing one).
    """

    one_from_other: F64 = array(3)
    places: int
    resemblance: float
    lead: float
    evidence: float
    refusal: str


@dataclass(frozen=True, eq=False)
class ScoredPlacement:
    """A placement (3), the similarity (m) found there (NaN off common ground), its evidence."""

    placement: F64
    found: F64
    evidence: float


def align(meeting: WalkPair, usual: float, parameters: AlignmentParameters) -> Registration:
    """The best placement of the other walk, with a refusal where the evidence falls short.

    `usual` is the similarity of these walks to themselves.
    """
    ranked = _ranked(meeting, usual, parameters)
    if not ranked or ranked[0].evidence <= 0:
        return Registration(np.zeros(3), 0, 0.0, 0.0, 0.0, "nothing sounds alike")
    best = ranked[0]
    known = np.isfinite(best.found)
    places = len(np.unique(_places(best, meeting)[known]))
    resemblance = float(best.found[known].mean() / usual)
    distinct_m = parameters.rival_m + 2 * meeting.sigma_m
    competing = [
        each
        for each in ranked[1:]
        if each.evidence >= parameters.rival_share * best.evidence
        and _apart_m(each.placement, best.placement, meeting) > distinct_m
    ]
    leads = [_lead(best, other, meeting) for other in competing]
    lead = min(leads, default=np.inf)
    refusal = ""
    if places < parameters.least_places:
        refusal = f"only {places} m2 in common"
    elif resemblance < parameters.least_resemblance:
        refusal = f"resembles no more than {resemblance:.0%} of the usual"
    elif best.evidence < parameters.least_evidence:
        refusal = f"{places} m2 in common resemble it too little"
    elif lead < parameters.least_lead:
        other = competing[int(np.argmin(leads))]
        apart_m = _apart_m(other.placement, best.placement, meeting)
        refusal = f"a placement {apart_m:.1f} m off fits nearly as well"
    return Registration(best.placement, places, resemblance, lead, best.evidence, refusal)


def usual_resemblance(
    poses: F64, scores: F32, apart: int, parameters: AlignmentParameters
) -> float | None:
    """Similarity of a walk (n, 3) to itself where it comes back, by its scores (n, n).

    Neighbours less than `apart` footsteps apart do not count; None where it never comes back.
    """
    count = np.arange(len(poses))
    own = np.where(np.abs(count[:, None] - count) < apart, -np.inf, scores)
    found = resemblances(poses, poses, own, parameters)
    known = found[np.isfinite(found)]
    return float(known.mean()) if len(known) else None


def resemblances(one: F64, other: F64, scores: F32, parameters: AlignmentParameters) -> F64:
    """The best score (m) of each pose of the other with one near it (n, 3); NaN without any.

    A score of minus infinity does not count.
    """
    count = min(NEIGHBOURS, len(one))
    tree = cKDTree(one[:, :2])
    _, near = tree.query(
        other[:, :2], k=[*range(1, count + 1)], distance_upper_bound=parameters.near_m
    )
    inside = near < len(one)
    near = np.where(inside, near, 0)
    turn_rad = np.abs(wrap_angle(one[near, 2] - other[:, None, 2]))
    inside &= turn_rad < parameters.turn_rad
    best = np.where(inside, scores[near, np.arange(len(other))[:, None]], -np.inf).max(axis=1)
    return np.where(np.isfinite(best), best, np.nan)


def _ranked(
    meeting: WalkPair, usual: float, parameters: AlignmentParameters
) -> list[ScoredPlacement]:
    """Placements that votes gather around, far apart from each other, the best first."""
    links = meeting.links
    strongest = np.argsort(-links.score, kind="stable")[: parameters.votes]
    seen = compose(meeting.one[links.i], links.i_from_j)[strongest]
    other = meeting.other[links.j[strongest]]
    votes = compose(seen, inverse(other))
    few = np.unique(np.linspace(0, len(votes) - 1, parameters.placements).astype(int))
    starts = votes[few] if len(votes) else votes
    placed, weight = _gathered(starts, seen, other, links.score[strongest], parameters)
    kept: list[F64] = []
    for new in placed[np.argsort(-weight, kind="stable")]:
        if all(_apart_m(new, each, meeting) > parameters.rival_m / 2 for each in kept):
            kept.append(new)
    judged = [_judged(each, meeting, usual, parameters) for each in kept]
    return sorted(judged, key=lambda each: -each.evidence)


def _judged(
    placement: F64, meeting: WalkPair, usual: float, parameters: AlignmentParameters
) -> ScoredPlacement:
    """A placement with its evidence: less than half the usual similarity counts against it."""
    there = compose(placement, meeting.other)
    found = resemblances(meeting.one, there, meeting.scores, parameters)
    return ScoredPlacement(placement, found, float(np.nansum(found - usual / 2)))


def _gathered(
    placements: F64, seen: F64, other: F64, score: F64, parameters: AlignmentParameters
) -> tuple[F64, F64]:
    """Placements (h, 3) moved to where the votes around them agree best, and their weight (h)."""
    a, b = _points(seen), _points(other)
    turn, shift = np.exp(1j * placements[:, 2]), placements[:, 0] + 1j * placements[:, 1]
    weight = np.zeros((len(placements), len(other)))
    for reach_m in REACH_M:
        off_m = np.abs(a[0] - turn[:, None] * b[0] - shift[:, None])
        along = (a[1] - a[0]) * np.conj(b[1] - b[0]) * np.conj(turn)[:, None]
        close = (off_m < reach_m) & (np.abs(np.angle(along)) < parameters.turn_rad)
        weight = close * score
        turn, shift = _fitted(a, b, weight, turn, shift)
    return np.column_stack([shift.real, shift.imag, np.angle(turn)]), weight.sum(axis=1)


def _fitted(a: C128, b: C128, weight: F64, turn: C128, shift: C128) -> tuple[C128, C128]:
    """Turns and shifts (h) that take points b (2, k) closest to a (2, k), by weights (h, k)."""
    total = 2 * np.maximum(weight.sum(axis=1), 1e-12)
    mean_a, mean_b = weight @ a.sum(axis=0) / total, weight @ b.sum(axis=0) / total
    product = weight @ (a * np.conj(b)).sum(axis=0) - total * mean_a * np.conj(mean_b)
    some = np.abs(product) > 1e-9
    turned = np.where(some, product / np.where(some, np.abs(product), 1.0), turn)
    return turned, np.where(some, mean_a - turned * mean_b, shift)


def _points(poses: F64) -> C128:
    """Where poses (k) are and what they look at, as complex numbers (2, k)."""
    at = poses[:, 0] + 1j * poses[:, 1]
    return np.stack([at, at + AHEAD_M * np.exp(1j * poses[:, 2])])


def _apart_m(one: F64, other: F64, meeting: WalkPair) -> float:
    """How far apart two placements put the walk, on average."""
    moved = compose(one, meeting.other) - compose(other, meeting.other)
    return float(np.linalg.norm(moved[:, :2], axis=1).mean())


def _places(judged: ScoredPlacement, meeting: WalkPair) -> I64:
    """The square metre (m) that each footstep of the walk lies in, as placed."""
    cells = np.round(compose(judged.placement, meeting.other)[:, :2]).astype(np.int64)
    return np.asarray(np.unique(cells, axis=0, return_inverse=True)[1]).reshape(-1)


def _lead(best: ScoredPlacement, other: ScoredPlacement, meeting: WalkPair) -> float:
    """How surely the best beats a competing one: its mean lead per place, in standard errors.

    Nothing is sure where they share hardly any ground.
    """
    both: Bool = np.isfinite(best.found) & np.isfinite(other.found)
    place = _places(best, meeting)[both]
    count = np.bincount(place)
    if (count > 0).sum() < FEWEST_PLACES:
        return 0.0
    sums = np.bincount(place, (best.found - other.found)[both])
    lead = sums[count > 0] / count[count > 0]
    error = lead.std(ddof=1) / np.sqrt(len(lead))
    return float(lead.mean() / max(error, 1e-9))
