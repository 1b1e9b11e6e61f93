"""Medium access in the page is that of the line, slot by slot, on vectors of the line."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

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
from tests.in_node import needs_node, passed_in_node

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
    (tmp_path / "medium_access.json").write_text(json.dumps(vectors))
    passed_in_node(
        Path(__file__).parent / "medium_access.test.mjs",
        ELFSLAM_VECTORS=tmp_path / "medium_access.json",
    )
