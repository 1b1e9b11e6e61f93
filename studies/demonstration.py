"""The simulated walks that the phone page plays to whoever has no phone at hand.

    python -m studies.demonstration

One walk maps a lounge, the other, by somebody else another day, is located there. Each is a FLAC
file with the band of the chirps and a JSON file with what was played and what moved.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import soundfile
from scipy import signal

from elfslam import serve
from elfslam.base.values import Recording
from elfslam.world.circumstances import Circumstances
from elfslam.world.device import BROWSER
from elfslam.world.simulate import load_world, simulate

FOLDER = Path(serve.__path__[0]) / "pages" / "demonstration"
WORLD, ROUNDS = "lounge", 3
SEEDS = {"walk": 7, "other": 8}
AS_PLAYED = Circumstances(jitter_s=0.025, softer_db=4.0)
"""As the page plays them."""
BAND_HZ = (14_300.0, 20_700.0)
"""What lies outside is noise, and would be most of the file."""


def write_walk(recording: Recording, folder: Path, name: str) -> None:
    """A recording as the two files of a walk."""
    audio, imu = recording.audio, recording.imu
    assert audio is not None
    assert imu is not None
    assert recording.played_t_s is not None
    assert recording.gain_db is not None
    band = signal.butter(8, BAND_HZ, "bandpass", fs=audio.rate_hz, output="sos")
    sound = signal.sosfiltfilt(band, audio.samples[0])
    soundfile.write(
        folder / f"{name}.flac", sound, audio.rate_hz, subtype="PCM_16", compression_level=1.0
    )
    moved = np.column_stack([imu.t_s, imu.accel_mps2, imu.gyro_radps])
    played = np.column_stack([recording.played_t_s, recording.gain_db])
    told = {"played": played.round(6).tolist(), "motion": moved.round(4).tolist()}
    (folder / f"{name}.json").write_text(json.dumps(told, separators=(",", ":")) + "\n")


def main() -> None:
    """Write both walks anew."""
    FOLDER.mkdir(exist_ok=True)
    for name, seed in SEEDS.items():
        recording, _ = simulate(
            load_world(WORLD), seed, rounds=ROUNDS, grade=BROWSER, circumstances=AS_PLAYED
        )
        write_walk(recording, FOLDER, name)


if __name__ == "__main__":
    main()
