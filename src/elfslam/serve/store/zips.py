"""The files of a recording's folder, and zips of them: unpacked with care, packed as sent."""

import io
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

from elfslam.base.errors import InputError
from elfslam.base.zips import opened_zip
from elfslam.serve.settings import Limits
from elfslam.serve.store.blobs import refuse_full_disk

FILE_NAMES = frozenset(
    (
        "recording.json",
        "audio.flac",
        "audio.wav",
        "frames.flac",
        "frames.wav",
        "frames.csv",
        "baseband.iq",
        "baseband.csv",
        "chirps.csv",
        "checkpoints.csv",
        "accelerometer.csv",
        "gyroscope.csv",
        "magnetometer.csv",
        "barometer.csv",
        "orientation.csv",
        "emr.csv",
        "wifi.csv",
        "odometry.tum",
        "odometry_sigma.csv",
        "truth.tum",
        "waypoints.csv",
        "truth_levels.csv",
    )
)
WHOLE = (".zip", ".tar.xz", ".txt", ".mat")
"""So end the names of whole recordings, and of what other programs write."""


def is_whole(name: str) -> bool:
    """Whether an upload of this name is all of a recording, or of several."""
    return name.lower().endswith(WHOLE)


def stem_of(name: str) -> str:
    """The name of such an upload without its ending."""
    ending = next((each for each in WHOLE if name.lower().endswith(each)), "")
    return name[: len(name) - len(ending)]


COPY_BYTES = 2**18
EPOCH = (1980, 1, 1, 0, 0, 0)
"""The date of every entry: the same files give the same bytes."""
MACOSX = "__MACOSX"


def unpack_recording(path: Path, folder: Path, limits: Limits) -> None:
    """The files of a recording in a .zip, at its top or in its one folder, put into `folder`.

    Other files are left out. Raises InputError for a broken or hostile zip, OSError ENOSPC.
    """
    with opened_zip(path) as packed:
        for name, entry in chosen_entries(packed.entries, limits).items():
            refuse_full_disk(folder, entry.file_size, limits.free_bytes)
            packed.unpack(entry, folder / name)


def chosen_entries(
    entries: Mapping[PurePosixPath, zipfile.ZipInfo], limits: Limits
) -> dict[str, zipfile.ZipInfo]:
    """The entries that are files of a recording, by name. Raises InputError."""
    chosen: dict[str, zipfile.ZipInfo] = {}
    folders = set()
    for path, entry in entries.items():
        if path.name not in FILE_NAMES or path.parts[0] == MACOSX:
            continue
        if len(path.parts) > 2 or path.name in chosen:
            raise InputError(f"the .zip holds several {path.name}; pack one recording alone")
        chosen[path.name] = entry
        folders.add(path.parent)
    if len(folders) > 1:
        raise InputError("the .zip holds several folders; pack one recording alone")
    _check_sizes(chosen, limits)
    return chosen


def _check_sizes(chosen: Mapping[str, zipfile.ZipInfo], limits: Limits) -> None:
    for name, entry in chosen.items():
        if entry.file_size > limits.file_bytes:
            raise InputError(f"{name} unpacks to more than {limits.file_bytes} bytes; cut it")
    whole = sum(entry.file_size for entry in chosen.values())
    if whole > limits.recording_bytes:
        raise InputError(f"the .zip unpacks to more than {limits.recording_bytes} bytes; cut it")


class _Sink(io.RawIOBase):
    """Collects what a zip writes until it is sent."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        self._parts.append(bytes(data))
        return len(self._parts[-1])

    def take(self) -> bytes:
        """What was written since the last time."""
        taken, self._parts = b"".join(self._parts), []
        return taken


def packed(files: Mapping[str, Path]) -> Iterator[bytes]:
    """A .zip of files by name, piece by piece; nothing is held but one piece.

    The files are opened at once, so that one deleted meanwhile is still sent. Raises OSError.
    """
    with ExitStack() as opening:
        streams = {name: opening.enter_context(path.open("rb")) for name, path in files.items()}
        return _packing(streams, opening.pop_all())


def _packing(streams: Mapping[str, BinaryIO], opened: ExitStack) -> Iterator[bytes]:
    sink = _Sink()
    with opened, zipfile.ZipFile(sink, "w") as archive:
        for name, stream in streams.items():
            entry = zipfile.ZipInfo(name, EPOCH)
            with stream, archive.open(entry, "w", force_zip64=True) as target:
                while chunk := stream.read(COPY_BYTES):
                    target.write(chunk)
                    yield sink.take()
    yield sink.take()
