"""The line in the page against the line in Python: every stage, on vectors of simulated walks."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.arrays import F32, F64
from elfslam.base.parameters import as_dict
from elfslam.base.values import (
    ECHO_RATE_HZ,
    Features,
    Fixes,
    FixStatus,
    FloorMap,
    Recording,
    Trajectory,
)
from elfslam.slam.front_end import dead_reckoning_nodes, extract_echoes
from elfslam.slam.parameters import Parameters
from elfslam.stages.chirp import make_chirp
from elfslam.stages.echo import (
    cut_echoes,
    find_arrivals,
    find_frames,
    frame_facts,
    matched_envelope,
    to_echo_rate,
)
from elfslam.stages.echo.arrivals import Frames
from elfslam.stages.feature import OnnxEncoder, extract_features, load_encoder
from elfslam.stages.floormap import trajectory_map
from elfslam.stages.locate import LocateParameters, locate_one_shot, spot_similarity
from elfslam.world.circumstances import Circumstances
from elfslam.world.simulate import load_world, simulate
from tests.in_node import needs_node, passed_in_node

HERE = Path(__file__).parent
MODULES = ("sound", "schedule", "encoder", "locate")
RATES_HZ = (44_100, 48_000)
WORLD, MAPPED_SEED, LOCATED_SEED = "studio", 100, 101
HARD_TO_TELL = LocateParameters(temperature=0.2, unknown_below=0.6)
"""With these every known place is ambiguous."""


@dataclass(frozen=True)
class Scene:
    """A map, and another walk that is located in it."""

    floor_map: FloorMap
    encoder: OnnxEncoder
    recording: Recording


def scene_at(rate_hz: int) -> Scene:
    """A walk mapped as dead reckoning has it, and another one beside it."""
    parameters, encoder = Parameters(), load_encoder("compact")
    assert isinstance(encoder, OnnxEncoder)
    walked, _ = simulate(load_world(WORLD), MAPPED_SEED, rounds=1)
    echoes, nodes = extract_echoes(walked, parameters), dead_reckoning_nodes(walked, parameters)
    covariance = np.tile(np.diag([0.01, 0.02, 0.001]), (len(nodes.t_s), 1, 1))
    covariance[:, 0, 1] = covariance[:, 1, 0] = 0.003
    covariance *= np.linspace(1.0, 3.0, len(nodes.t_s))[:, None, None]
    floor_map = trajectory_map(
        Trajectory(nodes.t_s, nodes.world_from_body, covariance, np.empty(0), "OK"),
        extract_features(echoes, encoder),
        parameters.floormap,
        parameters_digest="",
        source=walked.name,
    )
    recording, _ = simulate(load_world(WORLD), LOCATED_SEED, rounds=1, rate_hz=rate_hz)
    return Scene(floor_map, encoder, recording)


def write_floor_map(folder: Path, floor_map: FloorMap, parameters: Parameters) -> None:
    """`map.json` and arrays beside it, as the page holds them in memory."""
    folder.mkdir(parents=True, exist_ok=True)
    elf = next(item for item in floor_map.payloads if item.kind == "elf")
    groups = as_dict(parameters)
    told = {
        "encoder": elf.encoder,
        "parameters": {name: groups[name] for name in ("chirp", "echo", "locate")},
    }
    (folder / "map.json").write_text(json.dumps(told))
    covariance = floor_map.covariance_m2
    write_f32(folder, "xy", floor_map.xy_m)
    write_f32(folder, "heading", floor_map.heading_rad)
    write_f32(folder, "covariance", covariance[:, [0, 0, 1], [0, 1, 1]])
    write_f32(folder, "vectors", elf.vectors)


def write_f32(folder: Path, name: str, values: F32 | F64) -> None:
    """An array as little-endian float32."""
    values.astype("<f4").tofile(folder / f"{name}.f32")


def told_fixes(fixes: Fixes) -> list[dict[str, object]]:
    """Fixes as the page has them."""
    return [
        {
            "tS": float(fixes.t_s[k]),
            "xyM": None if np.isnan(fixes.xy_m[k, 0]) else fixes.xy_m[k].tolist(),
            "headingRad": _finite(fixes.heading_rad[k]),
            "covarianceM2": None
            if np.isnan(fixes.xy_m[k, 0])
            else fixes.covariance_m2[k][[0, 0, 1], [0, 1, 1]].tolist(),
            "score": _finite(fixes.score[k]),
            "status": FixStatus(fixes.status[k]).name,
        }
        for k in range(len(fixes.t_s))
    ]


def _finite(value: float) -> float | None:
    return None if np.isnan(value) else float(value)


def write_stages(folder: Path, scene: Scene) -> None:
    """Every stage of the located walk: sound to fixes."""
    parameters, audio = Parameters(), scene.recording.audio
    assert audio is not None
    chirp = make_chirp(parameters.chirp, audio.rate_hz)
    resampled = to_echo_rate(audio)
    envelope = matched_envelope(resampled, chirp)
    period = round(chirp.period_s * ECHO_RATE_HZ)
    arrivals = find_arrivals(envelope, period, parameters.echo)
    echoes = cut_echoes(audio, chirp, parameters.echo)
    write_floor_map(folder, scene.floor_map, parameters)
    stages = {
        "sound": audio.samples[0],
        "chirp": chirp.samples,
        "resampled": resampled,
        "envelope": envelope,
        "traces": echoes.samples,
        "elf": scene.encoder.embed(echoes.samples),
    }
    for name, values in stages.items():
        write_f32(folder, name, values)
    (folder / "encoder.onnx").write_bytes(scene.encoder.content)
    heard = extract_features(echoes, scene.encoder)
    told = {
        "rate_hz": audio.rate_hz,
        "identity": scene.encoder.identity,
        "arrivals": arrivals.samples.tolist(),
        "t_s": echoes.t_s.tolist(),
        "facts": told_facts(find_frames(audio, chirp, parameters.echo), parameters),
        "scheduled": scheduled(folder, audio.rate_hz, parameters),
        **located(folder, heard, scene.floor_map, parameters),
    }
    (folder / "stages.json").write_text(json.dumps(told))


def scheduled(folder: Path, rate_hz: int, parameters: Parameters) -> dict[str, object]:
    """A walk whose chirps are played at random within their periods, some softer.

    Its sound lies in a file.
    """
    today = Circumstances(jitter_s=0.025, softer_db=4.0)
    recording, _ = simulate(
        load_world(WORLD), LOCATED_SEED, rounds=1, rate_hz=rate_hz, circumstances=today
    )
    assert recording.audio is not None
    assert recording.played_t_s is not None
    assert recording.gain_db is not None
    write_f32(folder, "scheduled", recording.audio.samples[0])
    chirp = make_chirp(parameters.chirp, rate_hz)
    frames = find_frames(recording.audio, chirp, parameters.echo, recording.played_t_s)
    return {
        "played_s": recording.played_t_s.tolist(),
        "gain_db": recording.gain_db.tolist(),
        "arrivals": frames.arrivals.samples.tolist(),
        "facts": told_facts(frames, parameters),
    }


def told_facts(frames: Frames, parameters: Parameters) -> list[dict[str, float | None]]:
    """What was heard around each chirp, as the page tells it."""
    facts = frame_facts(frames, parameters.echo)
    names = {"dueS": facts.t_due_s, "lateS": facts.late_s} | {
        name: getattr(facts, name) for name in ("level", "before", "noise", "clipped")
    }
    return [
        {name: _finite(column[k]) for name, column in names.items()}
        for k in range(len(facts.level))
    ]


def located(
    folder: Path, heard: Features, floor_map: FloorMap, parameters: Parameters
) -> dict[str, object]:
    """Means, scores and fixes of features as they are heard in a map."""
    steps_s = heard.t_s[0] + 0.55 * np.arange(int((heard.t_s[-1] - heard.t_s[0]) / 0.55) + 1)
    means = heard.means_between(steps_s, parameters.locate.fewest_echoes)
    elf = next(item for item in floor_map.payloads if item.kind == "elf")
    write_f32(folder, "heard", heard.vectors)
    write_f32(folder, "means", means)
    write_f32(folder, "scores", spot_similarity(means, elf))
    return {
        "edges_s": steps_s.tolist(),
        "fixes": told_fixes(locate_one_shot(heard, floor_map, parameters.locate)),
        "ambiguous": told_fixes(locate_one_shot(heard, floor_map, HARD_TO_TELL)),
        "hard_to_tell": asdict(HARD_TO_TELL),
    }


@pytest.fixture(scope="session")
def vectors(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for each rate."""
    folder = tmp_path_factory.mktemp("line")
    for rate_hz in RATES_HZ:
        (folder / str(rate_hz)).mkdir()
        write_stages(folder / str(rate_hz), scene_at(rate_hz))
    return folder


@needs_node
@pytest.mark.parametrize("module", MODULES)
def test_the_line_in_the_page(module: str, vectors: Path) -> None:
    passed_in_node(HERE / f"{module}.test.mjs", ELFSLAM_VECTORS=vectors)
