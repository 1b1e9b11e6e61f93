"""A recording and a map on disk become fixes: what `elfslam locate` does."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from elfslam.app.floor import locate_by_field
from elfslam.app.settings import Settings
from elfslam.base.arrays import F32
from elfslam.base.enums import Modality, Mode
from elfslam.base.errors import InputError, StoreError
from elfslam.base.values import Fixes, FloorMap, Recording
from elfslam.data.atomic_files import settled
from elfslam.data.map_files import ENCODER, is_superimposed, read_map
from elfslam.data.recordings import read_recording
from elfslam.slam.front_end import extract_echoes
from elfslam.slam.pipeline import locate
from elfslam.stages.device_adaptation import learn_phone
from elfslam.stages.feature import Encoder, extract_features, load_encoder


def locate_from(
    path: Path,
    map_path: Path,
    settings: Settings,
    *,
    by: Collection[Modality] = (),
    encoder: str | None = None,
    mode: Mode = Mode.ONE_SHOT,
    seed: int = 0,
    phone_walk: Path | None = None,
) -> Fixes:
    """Fixes of the recording at `path` in the map at `map_path`.

    They go `by` the echoes where nothing else is named, by Wi-Fi where the map has no echoes. The
    encoder is the one beside the map where none is named. `phone_walk` is a walk of the same
    phone in that map, to learn how it hears. Raises InputError and StoreError.
    """
    floor_map = read_map(settled(map_path))
    kinds = {item.kind for item in floor_map.payloads}
    if by or kinds - {Modality.ELF} == kinds:
        senses = by or (Modality.WIFI,)
        return locate_by_field(path, map_path, floor_map, senses, settings, mode)
    headless = is_superimposed(map_path)
    if headless and mode is not Mode.ONE_SHOT:
        raise InputError(
            f"{map_path}: is superimposed and knows neither headings nor walks, which mode "
            f"{mode} goes by; use one-shot, or the map that it was made of",
            argument="mode",
        )
    used = load_encoder(encoder) if encoder else encoder_of(map_path, floor_map)
    recording = read_recording(path, settings.chirp)
    translation = None
    if phone_walk is not None:
        walk = read_recording(phone_walk, settings.chirp)
        translation = phone_translation(walk, floor_map, used, settings)
    fixes = locate(
        recording, floor_map, used, settings, mode=mode, seed=seed, translation=translation
    )
    return replace(fixes, heading_rad=np.full(len(fixes.t_s), np.nan)) if headless else fixes


def phone_translation(
    walk: Recording, floor_map: FloorMap, encoder: Encoder, settings: Settings
) -> F32:
    """What a phone's own walk in a map tells of how it hears (cross-device adaptation)."""
    heard = extract_features(extract_echoes(walk, settings), encoder)
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
            "(compact is the shipped one), or map the recording again",
            argument="encoder",
        )
    return load_encoder(str(beside))
