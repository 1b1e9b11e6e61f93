"""Two engines side by side: they agree, random rooms are sound, and differences are found."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.world import pyroom
from elfslam.world.paths import Reach
from elfslam.world.phone import C64, Transducers
from elfslam.world.pulses import Air
from elfslam.world.room import Room, check_outline
from elfslam.world.scene import Scene
from studies import fidelity
from studies.study import StudyContext

Draw = Callable[[np.random.Generator], Room]


def test_both_engines_agree_in_the_first_rooms() -> None:
    found = {
        (each.world, each.condition, each.metric): each.value
        for each in fidelity.measure_fidelity(StudyContext(), rooms=2)
    }
    limits = {
        "decorrelation, worst (%)": 1.0, "paths of one engine alone": 0.0,
        "arrival error, worst (us)": 2.0, "level error, worst (dB)": 0.3,
    }  # fmt: skip
    for world in ("shoebox", "polygon with blocks"):
        for lobe in ("omnidirectional", "cardioid"):
            assert all(found[world, lobe, metric] <= most for metric, most in limits.items())
            assert found[world, lobe, "paths compared"] > 50


def test_what_one_engine_lacks_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """An engine that loses all third reflections and more is found out."""
    whole = pyroom.image_echoes

    def shallow(scene: Scene, ends: Transducers, people_m: F64, air: Air, reach: Reach) -> C64:
        return whole(scene, ends, people_m, air, reach._replace(order=2))

    monkeypatch.setattr(pyroom, "image_echoes", shallow)
    assert fidelity.compare_room(fidelity.random_shoebox, 0.0, 0).correlation < 0.99


@pytest.mark.parametrize("draw", [fidelity.random_shoebox, fidelity.random_polygon])
def test_random_rooms_are_sound_and_the_same_for_a_seed(draw: Draw) -> None:
    for seed in range(10):
        room, again = (draw(np.random.default_rng(seed)) for _ in range(2))
        assert (room.outline_m == again.outline_m).all()
        assert (check_outline(room.outline_m) == room.outline_m).all()
        for k, block in enumerate(room.blocks):
            others = replace(room, blocks=room.blocks[:k] + room.blocks[k + 1 :])
            assert others.is_free(block.corners_m, 1.0).all()
            assert block.top_m == room.height_m
        ends = fidelity.random_ends(room, 0.5, np.random.default_rng(seed))
        assert room.is_free(np.vstack([ends.speaker, ends.microphone])[:, :2], 1.0, 0.2).all()
        np.testing.assert_allclose(np.linalg.norm(ends.speaker_axis), 1.0)
