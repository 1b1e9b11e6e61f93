"""An unknown phone: the planted translation is found, and nothing is claimed from too little."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import special_ortho_group

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError
from elfslam.base.values import Features, FloorMap, Payload
from elfslam.stages.device_adaptation import PhoneParameters, learn_phone, to_map_domain

SIZE = 16
KNOWN = PhoneParameters(ridge=2.0)


def unit(rows: F64) -> F32:
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True), dtype=np.float32)


def corridor(count: int = 120) -> FloorMap:
    """Spots 0.25 m apart whose ELFs change smoothly along the way."""
    draw = np.random.default_rng(0)
    knots = draw.standard_normal((count // 4 + 2, SIZE))
    at = np.arange(count) / 4
    share = (at % 1)[:, None]
    vectors = unit((1 - share) * knots[at.astype(int)] + share * knots[at.astype(int) + 1])
    return FloorMap(
        np.column_stack([0.25 * np.arange(count), np.zeros(count)]), np.zeros(count),
        np.zeros(count, dtype=np.int64), np.arange(count), np.tile(np.eye(2), (count, 1, 1)),
        (Payload("elf", "e", vectors),), "", (),
    )  # fmt: skip


def other_phone(strength: float) -> F64:
    """A rotation of ELFs; 0 is the map's own phone."""
    turned = special_ortho_group.rvs(SIZE, random_state=3)
    return np.asarray((1 - strength) * np.eye(SIZE) + strength * turned)


def walk(floor_map: FloorMap, phone: F64, *, noise: float = 0.1) -> tuple[Features, F64]:
    """A walk there and back at 1.25 m/s, and where (n) it was at each echo."""
    t_s = np.arange(440) * 0.1
    x_m = 29.0 - np.abs(29.0 - 1.25 * t_s - 1.0)
    spot = np.rint(x_m / 0.25).astype(int)
    hiss = noise * np.random.default_rng(1).standard_normal((len(t_s), SIZE))
    return Features(t_s, unit(floor_map.payloads[0].vectors[spot] @ phone + hiss), "e"), x_m


def lost_share(features: Features, floor_map: FloorMap, x_m: F64) -> float:
    """Of the echoes, those that sound like a spot more than 1 m off."""
    best = (features.vectors @ floor_map.payloads[0].vectors.T).argmax(axis=1)
    return float(np.mean(np.abs(floor_map.xy_m[best, 0] - x_m) > 1.0))


def test_another_phone_is_heard_as_the_maps() -> None:
    floor_map = corridor()
    features, x_m = walk(floor_map, other_phone(0.5))
    translated = to_map_domain(features, learn_phone(features, floor_map, KNOWN))
    assert lost_share(features, floor_map, x_m) > 0.2
    assert lost_share(translated, floor_map, x_m) < 0.08
    assert translated.encoder == "e"
    np.testing.assert_allclose(np.linalg.norm(translated.vectors, axis=1), 1.0, atol=1e-5)


def test_the_maps_own_phone_stays_as_it_was() -> None:
    floor_map = corridor()
    features, x_m = walk(floor_map, other_phone(0.0))
    translated = to_map_domain(features, learn_phone(features, floor_map, KNOWN))
    assert lost_share(translated, floor_map, x_m) < 0.02


def test_the_way_people_walk_settles_what_one_window_cannot() -> None:
    floor_map = corridor()
    features, x_m = walk(floor_map, other_phone(0.6))
    anywhere = replace(KNOWN, speed_mps=5.0, jump=0.0)
    free, walked = (
        lost_share(to_map_domain(features, learn_phone(features, floor_map, known)), floor_map, x_m)
        for known in (anywhere, KNOWN)
    )
    assert walked < 0.7 * free


def test_few_candidates_and_all_of_them_agree_where_the_match_is_clear() -> None:
    floor_map = corridor()
    features, _ = walk(floor_map, other_phone(0.2))
    few, every = (learn_phone(features, floor_map, replace(KNOWN, candidates=n)) for n in (20, 500))
    np.testing.assert_allclose(few, every, atol=0.05)


def test_spots_that_nobody_heard_are_left_out() -> None:
    floor_map = corridor()
    silent = np.array(floor_map.payloads[0].vectors)
    silent[7] = 0.0
    features, _ = walk(floor_map, other_phone(0.2))
    found = learn_phone(
        features, replace(floor_map, payloads=(Payload("elf", "e", silent),)), KNOWN
    )
    assert np.isfinite(found).all()


def test_a_strong_ridge_claims_that_phones_are_alike() -> None:
    floor_map = corridor()
    features, _ = walk(floor_map, other_phone(0.6))
    found = learn_phone(features, floor_map, replace(KNOWN, ridge=1e9))
    np.testing.assert_allclose(found, np.eye(SIZE), atol=1e-3)


def test_gaps_in_the_sound_are_bridged() -> None:
    floor_map = corridor()
    features, x_m = walk(floor_map, other_phone(0.5))
    kept = np.r_[0:150, 220:440]
    part = Features(features.t_s[kept], features.vectors[kept], "e")
    translated = to_map_domain(part, learn_phone(part, floor_map, KNOWN))
    assert lost_share(translated, floor_map, x_m[kept]) < 0.1


def test_a_short_walk_and_a_foreign_map_are_refused() -> None:
    floor_map = corridor()
    features, _ = walk(floor_map, other_phone(0.0))
    short = Features(features.t_s[:30], features.vectors[:30], "e")
    with pytest.raises(InputError, match="walk longer"):
        learn_phone(short, floor_map, KNOWN)
    with pytest.raises(InputError, match="no ELFs of encoder other"):
        learn_phone(replace(features, encoder="other"), floor_map, KNOWN)
