"""Medium access and the judge of sound in the page are those of the pipeline, slot by slot."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elfslam.base.arrays import I64
from elfslam.base.values import ECHO_SAMPLES, Echoes, FrameFacts
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.echo import matched_envelope
from elfslam.stages.medium_access import (
    CarrierSense,
    MediumAccessParameters,
    Slot,
    after_slot,
    hear_slot,
    initial_schedule,
    is_played,
    spoiled_frames,
)
from elfslam.stages.spoofing import REASONS, SpoofingParameters, judge, loudness
from tests.in_node import agrees_in_node, needs_node, passed_in_node

RATE_HZ = 44_100
PARAMETERS = MediumAccessParameters()


def schedule_vectors(parameters: MediumAccessParameters, seed: int) -> dict[str, Any]:
    generator = np.random.default_rng(seed)
    schedule, slots = initial_schedule(parameters), []
    for slot in range(400):
        draw = generator.uniform(size=2).tolist()
        busy = (slot > 30 and slot % 8 in (1, 4)) or generator.uniform() < 0.02
        others = generator.uniform(-0.03, 0.05, int(busy) * generator.integers(1, 3)).tolist()
        played = is_played(schedule, slot, draw[0], parameters)
        schedule = after_slot(schedule, slot, others, draw[1], parameters, played=played)
        slots.append(
            {"draw": draw, "others": others, "wanted": {**asdict(schedule), "played": played}}
        )
    return {"parameters": asdict(parameters), "slots": slots}


def hearing_vectors(folder: Path) -> dict[str, Any]:
    generator = np.random.default_rng(3)
    chirp = make_chirp(ChirpParameters(), RATE_HZ)
    samples = 1e-5 * generator.standard_normal(6 * RATE_HZ)
    dues: list[int | None] = []
    for slot in range(50):
        due = round((0.2 + 0.1 * slot + generator.uniform(0, 0.025)) * RATE_HZ)
        dues.append(due if slot % 3 else None)
        for gain, delay in ((0.2, 0), (0.02, 700), (0.01, 1900)) if slot % 3 else ():
            samples[due + delay : due + delay + 441] += gain * chirp.samples
        if slot % 3 == 0 or slot % 7 == 0:
            at = round((0.2 + 0.1 * slot + generator.uniform(-0.03, 0.06)) * RATE_HZ)
            for gain, delay in ((0.006, 0), (0.004, 900)):
                samples[at + delay : at + delay + 441] += gain * chirp.samples
    envelope = matched_envelope(samples.astype(np.float32), chirp)
    (folder / "envelope.f32").write_bytes(envelope.tobytes())
    listening, slots = CarrierSense(), []
    for k, due in enumerate(dues[:-1]):
        start = round((0.2 + 0.1 * k) * RATE_HZ)
        slot = Slot(start, start + 4410, due, dues[k + 1])
        first, last = start - 6000, start + 11_000
        others, listening = hear_slot(listening, envelope[first:last], first, slot, PARAMETERS)
        slots.append({"first": first, "last": last, "slot": asdict(slot), "wanted": list(others)})
    return {"envelope": str(folder / "envelope.f32"), "slots": slots}


def spoiled_vectors(folder: Path) -> dict[str, Any]:
    """Own chirps with moving echoes, some left out, and another's in some and before some."""
    generator = np.random.default_rng(4)
    chirp = make_chirp(ChirpParameters(), RATE_HZ)
    samples = 1e-5 * generator.standard_normal(7 * RATE_HZ)
    arrivals = []
    for k in range(60):
        if k in (9, 10, 11, 12, 13, 14, 30):
            continue
        at = round((0.3 + 0.1 * k + generator.uniform(0, 0.025)) * RATE_HZ)
        arrivals.append(at)
        for gain, delay in ((0.2, 0), (0.03, 700 + 2 * k), (0.01, 1900 - 3 * k)):
            samples[at + delay : at + delay + 441] += gain * chirp.samples
        if k % 5 == 2:
            other = at + round(generator.uniform(-0.018, 0.05) * RATE_HZ)
            samples[other : other + 441] += 0.02 * chirp.samples
    envelope = matched_envelope(samples.astype(np.float32), chirp)
    (folder / "spoiled.f32").write_bytes(envelope.tobytes())
    spoiled = spoiled_frames(envelope, np.array(arrivals), PARAMETERS)
    return {
        "envelope": str(folder / "spoiled.f32"),
        "arrivals": arrivals,
        "wanted": spoiled.tolist(),
    }


@needs_node
def test_medium_access_in_node(tmp_path: Path) -> None:
    eager = replace(PARAMETERS, slots=5, forget=20, follow=0.2, stir=0.1)
    vectors = {
        "parameters": asdict(PARAMETERS),
        "schedules": [
            schedule_vectors(each, seed) for seed, each in enumerate((PARAMETERS, eager))
        ],
        "spoiled": spoiled_vectors(tmp_path),
        **hearing_vectors(tmp_path),
    }
    agrees_in_node(HERE / "medium_access.test.mjs", vectors, tmp_path)


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
