"""The study of impulse responses: on planted ones, since the real ones are a test."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from scipy import signal

from elfslam.base.errors import InputError
from elfslam.base.values import DISCARDED_SAMPLES, ECHO_SAMPLES
from elfslam.baselines.generic import GenericEncoder
from elfslam.stages.chirp import ChirpParameters, make_chirp
from studies import real_rooms
from studies.study import StudyContext

RATE_HZ = 48_000
DIRECT = 480


def response(delays_s: np.ndarray, gains: np.ndarray) -> np.ndarray:
    made = np.zeros(6240)
    made[DIRECT] = 1.0
    made[DIRECT + np.round(delays_s * RATE_HZ).astype(int)] += gains
    return made


@pytest.fixture(scope="module")
def planted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three states of four places on two microphones; the second hears nothing of the place."""
    folder = tmp_path_factory.mktemp("data")
    generator = np.random.default_rng(0)
    delays_s = generator.uniform(0.012, 0.055, (4, 40))
    gains = generator.normal(0, 0.1, (4, 40))
    rir = np.zeros((3, 4, 6240, 2), dtype=np.float32)
    for state, place in np.ndindex(3, 4):
        absorbed = generator.uniform(0.8, 1.2, 40)
        rir[state, place, :, 0] = response(delays_s[place], absorbed * gains[place])
        rir[state, place, :, 1] = response(delays_s[0], generator.normal(0, 0.1, 40))
    for file in real_rooms.FILES.values():
        (folder / file).parent.mkdir(exist_ok=True)
        np.savez(folder / file, rir=rir, rate_hz=RATE_HZ, microphone=np.array(["near", "deaf"]))
    return folder


def test_the_pipeline_cuts_behind_the_direct_sound() -> None:
    """A reflection planted 20 ms behind the direct sound stands where it was planted."""
    chirp = make_chirp(replace(ChirpParameters(), period_s=real_rooms.PERIOD_S), RATE_HZ)
    echo = real_rooms.echo_of(response(np.array([0.020]), np.array([0.5])), chirp)
    assert echo.shape == (ECHO_SAMPLES,)
    energy = np.abs(signal.hilbert(echo))
    first = np.flatnonzero(energy > 0.1 * energy.max())[0]
    assert first == pytest.approx(0.020 * 44_100 - DISCARDED_SAMPLES, abs=60)


def test_known_places_are_recognised_and_others_are_not(planted: Path) -> None:
    deaf = GenericEncoder("deaf", lambda samples: np.ones((len(samples), 3), dtype=np.float32))
    found = real_rooms.measure_real_rooms(StudyContext(planted), encoders={"deaf": deaf})
    assert {each.world for each in found} == {"circle of 2 m", "circle of 1.5 m"}
    assert {each.metric for each in found} == {"top-1 accuracy"}
    value = {(each.condition, each.method): each.value for each in found}
    assert value["near", real_rooms.PLAIN] == 1.0
    assert value["near", "deaf"] == 0.25, "all the same, so the first is named"
    assert value["deaf", real_rooms.PLAIN] < 1.0


def test_what_a_microphone_adds_to_every_place_is_taken_away() -> None:
    generator = np.random.default_rng(0)
    vectors = np.repeat(generator.standard_normal((1, 5, 2, 40)), 3, axis=0).astype(np.float32)
    vectors[:, :, 1] = vectors[:, :, 0] - vectors[0, 0, 0] + vectors[0, 1, 0]
    assert not real_rooms.recognised(vectors, 1).all()
    assert real_rooms.recognised(real_rooms.own(vectors, places=1), 1).all()
    npt.assert_allclose(np.linalg.norm(real_rooms.own(vectors, places=1), axis=3), 1.0, atol=1e-6)


@pytest.mark.parametrize("given", [True, False])
def test_absent_recordings_are_refused(tmp_path: Path, *, given: bool) -> None:
    with pytest.raises(InputError, match="is absent; pass --data or set ELFSLAM_DATA"):
        real_rooms.measure_real_rooms(StudyContext(tmp_path if given else None))
