"""The studies that `elfslam study` knows, and how their tables are written."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Mapping
from pathlib import Path

from elfslam.base.errors import InputError
from elfslam.data.folders import new_file
from elfslam.studies.fidelity import compare_engines
from elfslam.studies.physics import check_laws
from elfslam.studies.sensors import compare_sensors

Row = dict[str, object]
Announce = Callable[[str, float | None], None]
Study = Callable[[Path | None, Announce], list[Row]]
"""Makes a table, given the folder of real recordings (or None) and who hears of progress."""

STUDIES: Mapping[str, Study] = {
    "fidelity": compare_engines,
    "physics": check_laws,
    "sensors": compare_sensors,
}


def run_study(name: str, out: Path, data: Path | None, announce: Announce) -> list[Row]:
    """The rows of a study, also written to `out` as name.json and name.csv.

    Raises InputError for a study that does not exist.
    """
    if name not in STUDIES:
        raise InputError(f"study {name!r}: wanted {', '.join(STUDIES)}; no such study")
    rows = STUDIES[name](data, announce)
    with new_file(out / f"{name}.json") as partial:
        partial.write_text(json.dumps(rows, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    with new_file(out / f"{name}.csv") as partial:
        _write_csv(partial, rows)
    return rows


def _write_csv(file: Path, rows: list[Row]) -> None:
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
