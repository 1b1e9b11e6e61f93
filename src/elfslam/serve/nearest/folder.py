"""An index as a folder: what it holds stands in one JSON file per revision.

A change writes new files and then the next `nearest-NNNNNN.json`; no file is ever changed in place,
so that whoever has the folder open goes on with the revision it has.
"""

from __future__ import annotations

import json
import os
import secrets
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.arrays import I64, Bool
from elfslam.base.errors import InputError, StoreError
from elfslam.data.atomic_files import sha256_of
from elfslam.serve.nearest.parameters import NearestParameters

FORMAT = 1


@dataclass(frozen=True)
class MapRange:
    """The spots of a map: ids `first` to `first + count - 1`; a removed one is not found."""

    name: str
    first: int
    count: int
    removed: bool = False


@dataclass(frozen=True)
class StoredFile:
    """A file of the folder, and how many spots it holds."""

    name: str
    spots: int
    bytes: int
    sha256: str


@dataclass(frozen=True)
class Meta:
    """What an index is: `main` (a FAISS file) holds the first spots, `vectors` rows of them.

    `added` are rows of spots that came later and are looked at one by one.
    """

    encoder: str
    size: int
    parameters: NearestParameters
    maps: tuple[MapRange, ...]
    main: StoredFile | None = None
    vectors: tuple[StoredFile, ...] = ()
    added: tuple[StoredFile, ...] = ()
    revision: int = 1
    software: dict[str, str] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """All ids that were ever given out."""
        return sum(each.count for each in self.maps)

    @property
    def files(self) -> tuple[StoredFile, ...]:
        """All files that this revision needs."""
        return (*([self.main] if self.main else []), *self.vectors, *self.added)

    @property
    def ends(self) -> I64:
        """The id after the last of each map (m)."""
        return np.cumsum([each.count for each in self.maps], dtype=np.int64)

    @property
    def gone(self) -> Bool | None:
        """Which ids (count) belong to removed maps; None where none is."""
        if not any(each.removed for each in self.maps):
            return None
        counts = [each.count for each in self.maps]
        return np.repeat([each.removed for each in self.maps], counts)


def stored(folder: Path, name: str, spots: int) -> StoredFile:
    """What is to be known of a file that was written to the folder."""
    file = folder / name
    return StoredFile(name, spots, file.stat().st_size, sha256_of(file))


def write_meta(folder: Path, meta: Meta) -> None:
    """The next revision, whole or not at all. Raises StoreError where another came first."""
    content = {"format": FORMAT, **asdict(meta)}
    partial = folder / f".{secrets.token_hex(4)}.partial"
    try:
        partial.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
        os.link(partial, meta_file(folder, meta.revision))
    except FileExistsError as cause:
        raise StoreError(
            f"{folder}: was changed by another at the same time; make the change again"
        ) from cause
    except OSError as cause:
        raise StoreError(f"{folder}: cannot be written ({cause}); choose another place") from cause
    finally:
        partial.unlink(missing_ok=True)


def meta_file(folder: Path, revision: int) -> Path:
    """Where a revision is described."""
    return folder / f"nearest-{revision:06d}.json"


def newest_revision(folder: Path) -> Path:
    """The file that describes the newest revision. Raises StoreError where there is none."""
    found = sorted(folder.glob("nearest-[0-9]*.json"))
    if not found:
        raise StoreError(f"{folder}: holds no index; name a folder that build_index made")
    return found[-1]


def read_meta(folder: Path) -> Meta:
    """The newest revision. Raises StoreError where there is none, or it is damaged."""
    return read_revision(newest_revision(folder))


def read_revision(file: Path) -> Meta:
    """One revision. Raises StoreError where it is damaged."""
    try:
        content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        if content.pop("format") != FORMAT:
            raise StoreError(f"{file}: is of another format; build the index again")
        return _meta(content)
    except (OSError, ValueError, TypeError, KeyError) as cause:
        raise StoreError(f"{file}: cannot be read ({cause}); build the index again") from cause


def _meta(content: dict[str, Any]) -> Meta:
    def files(name: str) -> tuple[StoredFile, ...]:
        return tuple(StoredFile(**each) for each in content.pop(name))

    main = content.pop("main")
    return Meta(
        vectors=files("vectors"),
        added=files("added"),
        main=StoredFile(**main) if main else None,
        maps=tuple(MapRange(**each) for each in content.pop("maps")),
        parameters=NearestParameters(**content.pop("parameters")),
        **content,
    )


def check_files(folder: Path, meta: Meta) -> None:
    """Raise StoreError for a file that is missing or of another length than it was written."""
    for each in meta.files:
        file = folder / each.name
        got = file.stat().st_size if file.is_file() else 0
        if got != each.bytes:
            raise StoreError(
                f"{file}: wanted {each.bytes} bytes, got {got}; copy or build the index again"
            )


def verify(folder: Path) -> None:
    """Read all of an index. Raises StoreError for a file whose digest is another."""
    meta = read_meta(folder)
    check_files(folder, meta)
    for each in meta.files:
        if sha256_of(folder / each.name) != each.sha256:
            raise StoreError(f"{folder / each.name}: was damaged; copy or build the index again")


def check_encoder(meta: Meta, encoder: str) -> None:
    """Raise InputError for vectors of another encoder than the index was made with."""
    if encoder != meta.encoder:
        raise InputError(
            f"encoder: wanted {meta.encoder}, which made the index, got {encoder}; "
            "use that encoder or build an index for this one"
        )


def tidy(folder: Path, before: Meta, meta: Meta) -> None:
    """Remove revisions older than the last two, and what only they needed."""
    kept = {each.name for each in (*before.files, *meta.files)}
    for file in sorted(folder.glob("nearest-[0-9]*.json")):
        if file < meta_file(folder, before.revision):
            for each in read_revision(file).files:
                if each.name not in kept:
                    (folder / each.name).unlink(missing_ok=True)
            file.unlink(missing_ok=True)
