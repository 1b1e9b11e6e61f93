"""A recording and a map on disk become fixes: what `elfslam locate` does."""

from __future__ import annotations

from pathlib import Path

from elfslam.app.settings import Settings
from elfslam.base.arrays import F32
from elfslam.base.choices import Mode
from elfslam.base.errors import StoreError
from elfslam.base.values import Fixes, FloorMap, Recording
from elfslam.data.facts import ENCODER
from elfslam.data.folders import settled
from elfslam.data.map_files import read_map
from elfslam.data.recordings import read_recording
from elfslam.line.device_adaptation import learn_phone
from elfslam.line.feature import Encoder, extract_features, load_encoder
from elfslam.slam.front_end import hear
from elfslam.slam.pipeline import locate


def locate_from(
    path: Path,
    map_path: Path,
    settings: Settings,
    *,
    encoder: str | None = None,
    mode: Mode = Mode.ONE_SHOT,
    seed: int = 0,
    phone_walk: Path | None = None,
) -> Fixes:
    """Fixes of the recording at `path` in the map at `map_path`.

    The encoder is the one beside the map where none is named. `phone_walk` is a walk of the same
    phone in that map, to learn how it hears. Raises InputError and StoreError.
    """
    floor_map = read_map(settled(map_path))
    used = load_encoder(encoder) if encoder else encoder_of(map_path, floor_map)
    recording = read_recording(path, settings.chirp)
    translation = None
    if phone_walk is not None:
        walk = read_recording(phone_walk, settings.chirp)
        translation = phone_translation(walk, floor_map, used, settings)
    return locate(
        recording, floor_map, used, settings, mode=mode, seed=seed, translation=translation
    )


def phone_translation(
    walk: Recording, floor_map: FloorMap, encoder: Encoder, settings: Settings
) -> F32:
    """What a phone's own walk in a map tells of how it hears (cross-device adaptation)."""
    heard = extract_features(hear(walk, settings), encoder)
    return learn_phone(heard, floor_map, settings.phone)


def encoder_of(path: Path, floor_map: FloorMap) -> Encoder:
    """The encoder beside the map; the one without learning where the map was made with that."""
    spectral = load_encoder("spectral")
    if {item.encoder for item in floor_map.payloads} <= {spectral.identity}:
        return spectral
    beside = (path if path.is_dir() else path.parent) / ENCODER
    if not beside.is_file():
        raise StoreError(
            f"{beside}: is missing and the map needs it; copy it from the run, name the encoder "
            "with --encoder (compact is the shipped one), or map the recording again"
        )
    return load_encoder(str(beside))
