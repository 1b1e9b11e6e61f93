"""A file that came whole, as the walks in it: a recording of ours, or other programs' logs.

A child of the server recognises the file by what is in it, and writes each walk as the folder of a
recording.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path, PurePath
from typing import Any

import numpy as np

from elfslam.base.errors import InputError, StoreError
from elfslam.base.zips import opened_zip
from elfslam.data.importing import FORMATS, LogFormat, Refused, read_logs, recognise
from elfslam.data.log_files import Imported, is_zip
from elfslam.data.recordings import write_recording
from elfslam.serve.parsing.child import without_places
from elfslam.serve.receiving.reader import ReadFolder, Walk, find
from elfslam.serve.settings import Limits
from elfslam.serve.store.blobs import refuse_full_disk
from elfslam.serve.store.zips import unpack_recording

DRIFT_SEED = 0
"""Of odometry that would else be the truth: the same log gives the same recording."""
COPIES = 2
"""What is unpacked lies there twice for a moment: as it came, and as it is kept."""


def parse(file: str, folder: str, most: int, limits: dict[str, Any]) -> list[dict[str, Any]]:
    """The walks of a file, `most` and no more, unpacked into a folder.

    Raises InputError, OSError ENOSPC.
    """
    tempfile.tempdir = folder  # whoever ends this process removes that, and all in it
    return [asdict(walk) for walk in _walks(Path(file), Path(folder), most, Limits(**limits))]


def _walks(file: Path, folder: Path, most: int, limits: Limits) -> list[Walk]:
    log_format = recognise(file)
    if log_format is None:
        return [_own(file, folder, limits)]
    _check_room(file, folder, limits)
    return list(_imported(log_format, file, folder, most, limits))


def _own(file: Path, folder: Path, limits: Limits) -> Walk:
    """All of a zip or nothing: what is cut short lies in a folder of its own."""
    partial, place = folder / ".partial", folder / file.stem
    partial.mkdir()
    unpack_recording(file, partial, limits)
    partial.rename(place)
    return Walk(find(place), place.name)


def _check_room(file: Path, folder: Path, limits: Limits) -> None:
    """Raise InputError for what unpacks to more than is allowed, OSError ENOSPC."""
    size_bytes = file.stat().st_size
    if is_zip(file):
        with opened_zip(file) as packed:
            size_bytes = sum(entry.file_size for entry in packed.entries.values())
    if size_bytes > limits.recording_bytes:
        raise InputError(
            f"{file}: unpacks to {size_bytes} bytes, wanted at most {limits.recording_bytes}; "
            "cut it in parts"
        )
    refuse_full_disk(folder, COPIES * size_bytes, limits.free_bytes)


def _imported(
    log_format: LogFormat, file: Path, folder: Path, most: int, limits: Limits
) -> Iterator[Walk]:
    """Every walk of a log. Raises InputError where there are too many, or too much in them."""
    left_bytes = limits.recording_bytes
    logs = read_logs(log_format, file, np.random.default_rng(DRIFT_SEED))
    for count, item in enumerate(logs):
        if count >= most:
            raise InputError(f"{file}: holds more than {most} walks; give it in parts")
        if isinstance(item, Refused):
            refusal = without_places(item.reason, file, folder)
            yield Walk(ReadFolder({"name": PurePath(item.name).stem}, refusal))
            continue
        place = folder / str(count)
        _write(item, place)
        left_bytes -= _size_bytes(place, limits)
        if left_bytes < 0:
            raise InputError(
                f"{file}: its walks are more than {limits.recording_bytes} bytes; give it in parts"
            )
        refuse_full_disk(folder, 0, limits.free_bytes)
        yield Walk(_read_back(place, log_format, item), place.name)


def _write(item: Imported, place: Path) -> None:
    try:
        write_recording(item.recording, place, truth=item.truth)
    except StoreError as error:
        raise error.__cause__ if isinstance(error.__cause__, OSError) else error from error


def _size_bytes(place: Path, limits: Limits) -> int:
    """How large the files of a walk are in all. Raises InputError for one that is too large."""
    sizes = {file.name: file.stat().st_size for file in place.iterdir()}
    for name, size_bytes in sizes.items():
        if size_bytes > limits.file_bytes:
            raise InputError(
                f"{name}: becomes {size_bytes} bytes, wanted at most {limits.file_bytes}; "
                "cut the walk in parts"
            )
    return sum(sizes.values())


def _read_back(place: Path, log_format: LogFormat, item: Imported) -> ReadFolder:
    """What is kept of a walk, as everybody will read it, and where it came from."""
    found = find(place)
    if found.refusal is not None:
        return found
    return replace(
        found,
        facts={
            **found.facts,
            "imported": str(log_format),
            "chirps": FORMATS[log_format].plays_chirps,
            "damaged_lines": item.damaged_lines,
        },
    )
