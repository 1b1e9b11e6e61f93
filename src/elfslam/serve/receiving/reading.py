"""What children of the server find in recordings from outside, within bounds of time and memory."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from elfslam.base.errors import InputError
from elfslam.serve.parsing.child import Bounds
from elfslam.serve.settings import Limits

if TYPE_CHECKING:
    from elfslam.serve.parsing.children import Children

READER, WALKS = "elfslam.serve.receiving.reader", "elfslam.serve.receiving.walks"


@dataclass(frozen=True)
class ReadFolder:
    """What a folder holds, or why it is no recording."""

    facts: dict[str, Any] = field(default_factory=dict)
    refusal: str | None = None


@dataclass(frozen=True)
class Walk:
    """What came of a walk in a file; `place` is the name of its folder, where there is one."""

    found: ReadFolder
    place: str | None = None


def bounds_of(limits: Limits) -> Bounds:
    """What reading a recording may cost."""
    return Bounds(
        processor_s=limits.reading_s,
        wall_s=limits.reading_s,
        memory_bytes=limits.reading_bytes,
        file_bytes=limits.recording_bytes,
        advice="cut it in parts",
    )


def read_apart(children: Children, folder: Path, limits: Limits) -> ReadFolder:
    """What a child finds in the folder of a recording.

    Raises Problem 503 where that was killed, 507 where the disk is full.
    """
    try:
        return ReadFolder(children.parse(READER, bounds_of(limits), folder=str(folder)))
    except InputError as refused:
        return ReadFolder(refusal=str(refused))


def walks_apart(
    children: Children, file: Path, folder: Path, most: int, limits: Limits
) -> list[Walk]:
    """What a child finds in a file, unpacked into `folder`; `most` walks and no more.

    Raises Problem 503 where that was killed, 507 where the disk is full.
    """
    given = {"file": str(file), "folder": str(folder), "most": most, "limits": asdict(limits)}
    try:
        told = children.parse(WALKS, bounds_of(limits), **given)
    except InputError as refused:
        return [Walk(ReadFolder(refusal=str(refused)))]
    return [Walk(ReadFolder(**each["found"]), each["place"]) for each in told]
