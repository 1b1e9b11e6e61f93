"""Files of published floors by their SHA-256, and the index of the spots in all of them.

The files lie at any URL that fsspec knows: a folder, S3, memory. The index is built from them and
kept in the data folder. Once it was built, floors come into it as they are published. Floors whose
features another encoder made than the shipped one are not in it: phones do not know which encoder
to ask with before they know the floor.
"""

from __future__ import annotations

import hashlib
import json
import os
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from sqlalchemy import select

from elfslam.base.arrays import F32
from elfslam.base.errors import InputError, StoreError
from elfslam.base.extras import installing
from elfslam.base.urls import has_secret, shown_url, without_secrets
from elfslam.data.atomic_files import replaced_file, sync
from elfslam.data.tiles import features_of
from elfslam.serve import nearest
from elfslam.serve.buildings.senses import EchoIndex, unit_rows
from elfslam.serve.services import Services
from elfslam.serve.settings import ServerSettings
from elfslam.serve.store.blobs import SHA256
from elfslam.serve.store.database import reading
from elfslam.serve.store.tables import Floor, FloorPart
from elfslam.stages.feature import load_encoder

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

CREDENTIALS = "leave it to the environment, such as AWS_SECRET_ACCESS_KEY"


@dataclass(frozen=True)
class Files:
    """Where the files lie: a file system, and a folder of it; `url` is what may be shown."""

    system: AbstractFileSystem
    root: str
    url: str

    def path(self, sha256: str) -> str:
        """Where a file lies. Raises ValueError where that is no SHA-256."""
        if not SHA256.fullmatch(sha256):
            raise ValueError(f"{sha256!r:.80} is no SHA-256")
        return f"{self.root}/{sha256[:2]}/{sha256}"


def open_files(settings: ServerSettings) -> Files:
    """The files of a server. Raises InputError where nothing here can read such a URL."""
    url = settings.files
    try:
        import fsspec

        if has_secret(url):
            raise ValueError(f"a password would be seen by all; {CREDENTIALS}")
        system, root = fsspec.core.url_to_fs(url, use_listings_cache=False)
    except (ImportError, OSError, ValueError) as error:
        said = without_secrets(str(error).partition("\n")[0], url)
        raise InputError(
            f"files at {shown_url(url)}: {said:.200}; wanted such as "
            "s3://BUCKET/PREFIX, gs://, abfs://, memory:// or file:///FOLDER; where a module is "
            f"missing, {installing('buildings')}"
        ) from error
    return Files(system, str(root).rstrip("/"), shown_url(url))


def put(files: Files, content: bytes) -> str:
    """Keep a file, whole or not at all, and once; its SHA-256. Raises StoreError."""
    sha256 = hashlib.sha256(content).hexdigest()
    path = files.path(sha256)
    with _said(files):
        if _size_bytes(files, path) != len(content):
            _write(files, path, content)
    return sha256


def read(files: Files, sha256: str) -> bytes:
    """The content of a file. Raises FileNotFoundError, StoreError."""
    with _said(files):
        content = files.system.cat_file(files.path(sha256))
    assert isinstance(content, bytes)
    return content


def delete(files: Files, sha256s: Iterable[str]) -> None:
    """Remove files; those that are gone already are no error. Raises StoreError."""
    with _said(files):
        for sha256 in sha256s:
            with suppress(FileNotFoundError):
                files.system.rm_file(files.path(sha256))


def listed(files: Files) -> Iterator[str]:
    """The SHA-256 of all that is kept. Raises StoreError."""
    with _said(files):
        found = files.system.find(files.root) if files.system.exists(files.root) else []
    names = (path.rpartition("/")[2] for path in found)
    return (name for name in names if SHA256.fullmatch(name))


def _size_bytes(files: Files, path: str) -> int | None:
    try:
        return int(files.system.info(path)["size"])
    except FileNotFoundError:
        return None


def _write(files: Files, path: str, content: bytes) -> None:
    """Object stores write whole; in a folder a file gets its name when its bytes are down."""
    if "file" not in _protocols(files):
        files.system.pipe_file(path, content)
        return
    with replaced_file(Path(path)) as partial, partial.open("wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    sync(Path(path).parent)


def _protocols(files: Files) -> tuple[str, ...]:
    told = files.system.protocol
    return (told,) if isinstance(told, str) else tuple(told)


@contextmanager
def _said(files: Files) -> Iterator[None]:
    """What goes wrong at a store in one line, but for a file that is not there."""
    try:
        yield
    except (FileNotFoundError, StoreError, InputError, ValueError):
        raise
    except Exception as error:
        first = str(error).strip().partition("\n")[0]
        raise StoreError(
            f"files at {files.url}: {type(error).__name__}: {first:.200}; is the store there, and "
            "may you write to it?"
        ) from error


def published_manifest(services: Services, map_id: str) -> str | None:
    """The manifest of a floor by the id of its map; None where there is no such floor."""
    with reading(services.sessions) as session:
        return session.scalar(select(Floor.manifest).filter_by(id=map_id))


def published_part(services: Services, map_id: str, sha256: str) -> bytes | None:
    """A part of a floor's package; None where that has no such part. Raises StoreError."""
    wanted = select(FloorPart.sha256).join(Floor).where(Floor.id == map_id)
    with reading(services.sessions) as session:
        named = session.scalar(wanted.where(FloorPart.sha256 == sha256))
    if named is None:
        return None
    try:
        return read(open_files(services.settings), named)
    except FileNotFoundError:
        return None


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
    files = open_files(services.settings)
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
    rows = dict(_spots(services, open_files(services.settings), shipped_encoder(), map_id))
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
        parts = [read(files, each["sha256"]) for each in manifest["features"]]
    except FileNotFoundError as error:
        raise StoreError(f"{manifest['name']}: a part of it is gone; publish it again") from error
    return np.vstack([features_of(part) for part in parts])
