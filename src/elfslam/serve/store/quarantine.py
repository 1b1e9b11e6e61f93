"""Files that no row names, set aside before they are deleted, and put back if a row names them."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from elfslam.serve.store.blobs import SHA256, blob_path, put_at

IsNamed = Callable[[str], bool]


def set_aside(files: list[Path], quarantine: Path) -> int:
    """Move files into a quarantine by their names; how many those were."""
    for file in files:
        os.replace(file, quarantine / file.name)
    return len(files)


def unnamed_blobs(blobs: Path, is_named: IsNamed) -> list[Path]:
    """What lies among the blobs and is named by nobody, or was left half-written."""
    return [
        file
        for file in blobs.glob("*/*")
        if not (SHA256.fullmatch(file.name) and is_named(file.name))
    ]


def put_back(quarantine: Path, blobs: Path, is_named: IsNamed) -> int:
    """Move those blobs back that a row names after all; how many those were."""
    wanted = [
        file for file in quarantine.iterdir() if SHA256.fullmatch(file.name) and is_named(file.name)
    ]
    for file in wanted:
        kept = blob_path(blobs, file.name)
        kept.parent.mkdir(exist_ok=True, mode=0o700)
        put_at(file, kept)
    return len(wanted)
