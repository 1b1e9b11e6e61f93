"""An index as a folder: what it holds stands in one JSON file per revision, spots as unit rows.

A change writes new files and then the next `nearest-NNNNNN.json`; no file is ever changed in place,
so that whoever has the folder open goes on with the revision it has.
"""

import json
import os
import secrets
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from elfslam.base.arrays import F32, I64, Bool
from elfslam.base.errors import InputError, ParameterError, StoreError
from elfslam.base.parameters import parameter
from elfslam.data.atomic_files import sha256_of

KINDS = ("flat", "ivf-flat", "ivf-pq", "hnsw")


@dataclass(frozen=True)
class NearestParameters:
    """How an index is built and searched; `effort` is what a search can be asked to change.

    The kinds: flat looks at every spot (no extra needed); ivf-flat looks at the cells next to the
    query (Sivic and Zisserman, ICCV 2003), ivf-pq at codes in them (Jegou et al., TPAMI 33, 2011);
    hnsw walks along a graph of neighbours (Malkov and Yashunin, TPAMI 42, 2020).
    """

    kind: str = parameter("ivf-flat", "", f"{', '.join(KINDS[:-1])} or {KINDS[-1]}")
    cells: int = parameter(
        0, "", "cells of an ivf index; 0: the power of two above the root of the spots", low=0
    )
    effort: int = parameter(
        32, "", "cells (ivf) or open ends (hnsw) that a search looks at", low=1, high=65536
    )
    code_bytes: int = parameter(32, "bytes", "of a spot's code in ivf-pq", low=1, high=128)
    refine: int = parameter(
        0, "", "candidates for each answer of ivf-pq that are compared in full; 0: none", low=0
    )
    links: int = parameter(16, "", "neighbours of a spot in hnsw", low=4, high=128)
    breadth: int = parameter(80, "", "open ends while an hnsw index is built", low=8, high=2000)
    examples: int = parameter(40, "", "spots per cell that the cells are learnt from", low=1)
    seed: int = parameter(0, "", "of the choice of these", low=0)


def checked(parameters: NearestParameters, size: int) -> NearestParameters:
    """The same parameters. Raises ParameterError where they do not go with vectors of `size`."""
    if parameters.kind not in KINDS:
        raise ParameterError(
            f"nearest.kind: wanted {', '.join(KINDS)}, got {parameters.kind!r}; name one of them"
        )
    if parameters.kind == "ivf-pq" and size % parameters.code_bytes:
        raise ParameterError(
            f"nearest.code_bytes: wanted a divisor of {size}, got {parameters.code_bytes}; "
            "for example 32"
        )
    return parameters


Rows = npt.NDArray[Any]
BLOCK_ROWS = 65_536
LENGTH_TOLERANCE = 5e-3
"""Half precision moves the length of a row by less."""


def check_rows(rows: Rows, size: int | None, name: str) -> Rows:
    """The same rows (n, size). Raises InputError for another shape, NaN and rows not of length 1.

    `size` None takes any width.
    """
    wanted = "n" if size is None else str(size)
    if rows.ndim != 2 or rows.dtype.kind != "f" or (size is not None and rows.shape[1] != size):
        raise InputError(
            f"{name}: wanted numbers (n, {wanted}), got {rows.dtype} {rows.shape}; "
            "use the encoder that the index was made with"
        )
    for first in range(0, len(rows), BLOCK_ROWS):
        length = np.linalg.norm(rows[first : first + BLOCK_ROWS].astype(np.float32), axis=1)
        bad = ~(np.abs(length - 1.0) <= LENGTH_TOLERANCE)
        if bad.any():
            row = int(np.argmax(bad))
            raise InputError(
                f"{name}: wanted rows of length 1, got {length[row]:.3g} in row {first + row}; "
                "normalise the rows and drop those without echoes"
            )
    return rows


def read_rows(file: Path) -> Rows:
    """The rows of a .npy file, mapped. Raises StoreError where it is missing or cut off."""
    try:
        return np.asarray(np.load(file, mmap_mode="r", allow_pickle=False))
    except (OSError, ValueError, EOFError) as cause:
        reason = str(cause).splitlines()[0]
        raise StoreError(f"{file}: cannot be read ({reason}); copy or build it again") from cause


def write_rows(file: Path, rows: Rows) -> None:
    """The rows in half precision, flushed to the disk."""
    with file.open("wb") as stream:
        np.save(stream, rows.astype(np.float16, copy=False))
        stream.flush()
        os.fsync(stream.fileno())


def place_rows(given: Rows | Path, file: Path) -> None:
    """A shard put into a folder: rows are written, a file is linked or copied."""
    if not isinstance(given, Path):
        write_rows(file, given)
    elif read_rows(given).dtype != np.float16:
        write_rows(file, read_rows(given))
    else:
        try:
            os.link(given.resolve(), file)
        except OSError:
            shutil.copyfile(given, file)


def loaded(given: Rows | Path) -> Rows:
    """A shard as rows: given as they are, or in a file."""
    return read_rows(given) if isinstance(given, Path) else np.asarray(given)


def blocks(shards: Sequence[Rows], size: int = BLOCK_ROWS) -> Iterator[tuple[int, F32]]:
    """The number of the first row, and the rows, of block after block of all shards."""
    offset = 0
    for shard in shards:
        for first in range(0, len(shard), size):
            yield offset + first, np.asarray(shard[first : first + size], dtype=np.float32)
        offset += len(shard)


def take(shards: Sequence[Rows], ids: I64) -> F32:
    """The rows (n, size) with these numbers."""
    ends = np.cumsum([len(shard) for shard in shards])
    which = np.searchsorted(ends, ids, side="right")
    found = np.empty((len(ids), shards[0].shape[1]), dtype=np.float32)
    for k in np.unique(which):
        here = which == k
        found[here] = shards[k][ids[here] - (ends[k] - len(shards[k]))]
    return found


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
