"""The page's judge of sound in node: the same reasons at the same times as the line's."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elfslam.base.arrays import I64
from elfslam.base.values import ECHO_SAMPLES, Echoes, FrameFacts
from elfslam.stages.spoofing import REASONS, SpoofingParameters, judge, loudness
from tests.in_node import needs_node, passed_in_node

HERE = Path(__file__).parent
COUNT = 480


def heard(seed: int) -> tuple[FrameFacts, Echoes]:
    """Frames of which stretches are odd, each in another way; some have no echo."""
    generator = np.random.default_rng(seed)
    due_s = 0.5 + 0.1 * np.arange(COUNT) + generator.uniform(0, 0.025, COUNT)
    stretch = np.arange(COUNT) // 40 % len(REASONS)
    struck = (generator.uniform(size=COUNT) < 0.6) * stretch
    late_s = generator.normal(0, 1e-4, COUNT) + np.where(struck == 1, 0.004, 0.0)
    late_s[(struck == 1) & (generator.uniform(size=COUNT) < 0.5)] = np.nan
    level = 0.2 * 10 ** (generator.normal(0, 0.3, COUNT) / 20)
    gain_db = np.where(generator.uniform(size=COUNT) < 0.5, -6.0, 0.0)
    before = np.where(struck == 2, 0.3, 0.01)
    noise = np.where(struck == 4, 0.05, 1e-5)
    clipped = np.where(struck == 5, 0.1, 0.0)
    facts = FrameFacts(due_s, late_s, level, before, noise, clipped)
    kept = ~np.isnan(late_s) & (np.arange(COUNT) % 17 > 0)
    gain = np.where(struck == 3, 0.6, 0.002) * level
    played = 10 ** (gain_db / 20)
    lagging = stretch == 6
    gain = np.where(lagging, np.hypot(gain * played, 0.002 * 0.2), gain * played)
    facts = replace(facts, level=level * played, gain_db=gain_db)
    samples = gain[:, None] * generator.normal(size=(COUNT, ECHO_SAMPLES))
    samples = samples[kept].astype(np.float32)
    echoes = Echoes((due_s + late_s)[kept], samples, np.zeros((0, 2)))
    return facts, echoes


def vectors(seed: int) -> dict[str, Any]:
    facts, echoes = heard(seed)
    edges_s = np.arange(0.0, facts.t_due_s[-1] + 0.5, 0.55)
    known = SpoofingParameters(compared_chirps=16)
    columns = {
        "dueS": facts.t_due_s, "lateS": facts.late_s, "level": facts.level,
        "before": facts.before, "noise": facts.noise, "clipped": facts.clipped,
        "gainDb": facts.gain_db,
    }  # fmt: skip
    frames = [
        {
            name: None if np.isnan(values[k]) else float(values[k])
            for name, values in columns.items()
        }
        for k in range(COUNT)
    ]
    clean = np.flatnonzero(np.arange(len(echoes.t_s)) % 4 > 0)
    few = np.linspace(0, len(echoes.t_s) - 1, 5).astype(int)
    at = [int(np.argmin(abs(facts.t_due_s - echoes.t_s[k]))) for k in few]
    return {
        "parameters": asdict(known),
        "reasons": list(REASONS),
        "frames": frames,
        "echoes": [
            {"tS": float(t_s), "gain": float(np.abs(row).max())}
            for t_s, row in zip(echoes.t_s, echoes.samples, strict=True)
        ],
        "endsS": edges_s[1:].tolist(),
        "found": judge(facts, echoes, edges_s, known).tolist(),
        "clean": clean.tolist(),
        "foundClean": judge(facts, echoes, edges_s, known, _rows(echoes, clean)).tolist(),
        "some": [
            {"row": int(k), "loud": (loudness(facts, echoes)[frame] * facts.level[frame]).tolist()}
            for k, frame in zip(few, at, strict=True)
        ],
    }


def _rows(echoes: Echoes, rows: I64) -> Echoes:
    return Echoes(echoes.t_s[rows], echoes.samples[rows], echoes.losses_s)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("spoofing")
    (made / "spoofing.json").write_text(json.dumps(vectors(1)))
    heard(1)[1].samples.astype("<f4").tofile(made / "samples.f32")
    return made


@needs_node
def test_the_judge_is_that_of_the_line(folder: Path) -> None:
    passed_in_node(HERE / "spoofing.test.mjs", ELFSLAM_VECTORS=folder)


def test_every_reason_is_met() -> None:
    assert set(vectors(1)["found"]) == set(range(len(REASONS)))
