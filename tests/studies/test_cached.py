"""Walks are simulated once: the cache gives what the simulator gives, and forgets with the code."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from elfslam.app.settings import Settings
from elfslam.slam import front_end
from elfslam.stages.feature import SpectralEncoder
from elfslam.world import simulate as simulator
from elfslam.world.simulate import load_world
from studies import cached
from studies.cached import bound_cache, extract_echoes, extract_features, simulate


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setenv("ELFSLAM_CACHE", str(tmp_path))
    cached._memory.cache_clear()
    yield tmp_path
    cached._memory.cache_clear()


def test_a_walk_its_echoes_and_features_are_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    world, encoder = load_world("studio"), SpectralEncoder()
    walk, truth = simulate(world, 100, rounds=1)
    echoes = extract_echoes(walk, Settings())
    features = extract_features(echoes, encoder)
    steps = ((simulator, "simulate"), (front_end, "extract_echoes"), (cached, "extract"))
    for module, name in steps:
        monkeypatch.setattr(module, name, lambda *given, **how: pytest.fail("made again"))
    again, truth_again = simulate(world, 100, rounds=1)
    np.testing.assert_array_equal(again.audio.samples, walk.audio.samples)
    np.testing.assert_array_equal(truth_again.world_from_body, truth.world_from_body)
    np.testing.assert_array_equal(extract_echoes(again, Settings()).samples, echoes.samples)
    np.testing.assert_array_equal(extract_features(echoes, encoder).vectors, features.vectors)


def test_changed_code_makes_a_walk_again(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []
    real = simulator.simulate
    monkeypatch.setattr(simulator, "simulate",
                        lambda *given, **how: made.append(1) or real(*given, **how))  # fmt: skip
    for digest in ("before", "before", "after"):
        monkeypatch.setattr(cached, "_digest", lambda module, digest=digest: digest)
        simulate(load_world("studio"), 100, rounds=1, sound=False)
    assert len(made) == 2


def test_the_cache_is_bounded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    simulate(load_world("studio"), 100, rounds=1, sound=False)
    assert any(folder.rglob("output.pkl"))
    monkeypatch.setattr(cached, "MOST_BYTES", 0)
    bound_cache()
    assert not any(folder.rglob("output.pkl"))


def test_without_a_folder_nothing_is_kept(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ELFSLAM_CACHE", "")
    cached._memory.cache_clear()
    simulate(load_world("studio"), 100, rounds=1, sound=False)
    bound_cache()
    assert list(folder.iterdir()) == []
