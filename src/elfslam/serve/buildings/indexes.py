"""The index of the spots of all published floors: built from their files, kept in the data folder.

Once it was built, floors come into it as they are published.

Floors whose features another encoder made than the shipped one are not in it: phones do not know
which encoder to ask with before they know the floor.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from sqlalchemy import select

from elfslam.base.arrays import F32
from elfslam.base.errors import InputError, StoreError
from elfslam.data.tiles import features_of
from elfslam.serve import nearest
from elfslam.serve.buildings import files as store
from elfslam.serve.buildings.files import Files
from elfslam.serve.buildings.senses import EchoIndex, unit_rows
from elfslam.serve.services import Services
from elfslam.serve.store.database import reading
from elfslam.serve.store.tables import Floor
from elfslam.stages.feature import load_encoder

FOLDER, LATEST = "nearest", "latest"
MOST_ADDED = 20_000
"""Spots that came later are looked at one by one; so many of them, and the index takes them in."""
_OPENED: dict[Path, EchoIndex] = {}
_OPENING = threading.Lock()


def shipped_encoder() -> str:
    """The identity of the encoder whose features the index holds."""
    return load_encoder("compact").identity


def index_floors(services: Services, parameters: nearest.NearestParameters) -> tuple[int, int]:
    """Build the index anew; how many floors and spots are in it. Raises InputError, StoreError.

    A server that runs searches it from its next question on.
    """
    folder = services.settings.data_folder / FOLDER
    folder.mkdir(exist_ok=True)
    files = store.open_files(services.settings)
    rows = dict(_spots(services, files, shipped_encoder()))
    if not rows:
        raise InputError("index: no published floor has features of the shipped encoder")
    number = max((int(each.name) for each in folder.glob("[0-9]*")), default=0) + 1
    counts = {map_id: len(spots) for map_id, spots in rows.items()}
    nearest.build_index(
        list(rows.values()), folder / f"{number:06d}", parameters, encoder=shipped_encoder(),
        maps=counts,
    )  # fmt: skip
    partial = folder / f".{LATEST}"
    partial.write_text(f"{number:06d}", encoding="utf-8")
    partial.replace(folder / LATEST)
    return len(rows), sum(counts.values())


def index_floor(services: Services, map_id: str) -> bool:
    """Put a floor as it is published now into the index; whether it is in it then.

    It is not where no index was built yet, or another encoder made its features. A server that
    runs finds it from its next question on. Raises StoreError.
    """
    folder = _latest(services)
    if folder is None:
        return False
    if any(each.name == map_id and not each.removed for each in nearest.read_meta(folder).maps):
        nearest.remove_map(folder, map_id)
    rows = dict(_spots(services, store.open_files(services.settings), shipped_encoder(), map_id))
    for name, spots in rows.items():
        meta = nearest.add_map(folder, name, spots, encoder=shipped_encoder())
        if sum(each.spots for each in meta.added) > MOST_ADDED:
            nearest.absorb(folder)
    return map_id in rows


def index_of(services: Services) -> EchoIndex | None:
    """The newest revision of a server's index, or none; each is opened once."""
    folder = _latest(services)
    if folder is None:
        return None
    revision = nearest.newest_revision(folder)
    with _OPENING:
        if revision not in _OPENED:
            for older in [each for each in _OPENED if each.parent.parent == folder.parent]:
                del _OPENED[older]
            _OPENED[revision] = _opened(folder)
        return _OPENED[revision]


def _latest(services: Services) -> Path | None:
    folder = services.settings.data_folder / FOLDER
    try:
        return folder / (folder / LATEST).read_text(encoding="utf-8")
    except FileNotFoundError:
        return None


def _opened(folder: Path) -> EchoIndex:
    index = nearest.open_index(folder)
    return EchoIndex(
        index, index.map_of, tuple(each.name for each in index.meta.maps), index.meta.encoder
    )


def _spots(
    services: Services, files: Files, encoder: str, only: str | None = None
) -> Iterator[tuple[str, F32]]:
    """Unit rows of the spots of each floor, or of one, by the id of its map."""
    wanted = select(Floor.id, Floor.manifest).order_by(Floor.number)
    with reading(services.sessions) as session:
        floors = session.execute(wanted if only is None else wanted.where(Floor.id == only)).all()
    for map_id, manifest in floors:
        told: dict[str, Any] = json.loads(manifest)
        if told.get("encoder", {}).get("identity") == encoder:
            yield map_id, unit_rows(_features(files, told))


def _features(files: Files, manifest: dict[str, Any]) -> F32:
    try:
        parts = [store.read(files, each["sha256"]) for each in manifest["features"]]
    except FileNotFoundError as error:
        raise StoreError(f"{manifest['name']}: a part of it is gone; publish it again") from error
    return np.vstack([features_of(part) for part in parts])
