"""What a run says of itself, and the names of the files in its folder that others ask for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from elfslam.base.errors import InputError, StoreError
from elfslam.base.text_files import read_json

FACTS, ENCODER = "run.json", "encoder.onnx"
BY_TAPS = "by taps on a floor plan"
"""The `heading` of a walk that lies where its walker tapped."""
MISSING, NOTES = "missing", "notes"
"""Under these names run.json lists the stretches in which the recording lacked sound or motion,
and what else was not as it should be."""


def read_facts(folder: Path) -> dict[str, Any]:
    """What run.json says: parameters, digests, versions. Raises StoreError."""
    return read_object(folder / FACTS)


def read_object(file: Path) -> dict[str, Any]:
    """The JSON object in a file of a run. Raises StoreError where it is missing or damaged."""
    try:
        content = read_json(file)
    except InputError as cause:
        raise StoreError(f"{file}: is missing or damaged ({cause}); map again") from cause
    if not isinstance(content, dict):
        raise StoreError(f"{file}: wanted a JSON object; map the recording again")
    return content
