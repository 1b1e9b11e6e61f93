"""The studies by name, and how their tables are written."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from elfslam.app.workers import Workers, open_workers
from elfslam.base.errors import InputError
from elfslam.base.progress import Announce
from elfslam.data.folders import replaced_file
from elfslam.line.feature import Encoder
from elfslam.scoring.page import save_page
from elfslam.world.kinds import kind_named
from studies.acoustic_odometry import measure_acoustic_odometry
from studies.amounts import measure_amounts
from studies.attacks import measure_attacks
from studies.closure_steps import measure_closure_steps
from studies.contention import measure_contention
from studies.dead_reckoning import measure_dead_reckoning
from studies.displacement import measure_displacement
from studies.distinctness import measure_distinctness
from studies.elf import measure_elf
from studies.fidelity import compare_engines
from studies.finding import Finding, Given, LongStudy, Row, Study
from studies.finetuning import measure_finetuning
from studies.fix_thresholds import measure_fix_thresholds
from studies.floor_plan import measure_floor_plan
from studies.laps import measure_laps
from studies.localization import measure_localization
from studies.localization_cost import measure_localization_cost
from studies.magnetic_left_out import measure_magnetic_left_out
from studies.magnetic_walks import measure_magnetic_walks
from studies.mall_fifths import measure_mall_fifths
from studies.mall_floor import measure_mall_floor
from studies.many_mappers import measure_many_mappers
from studies.mapping_errors import measure_mapping
from studies.merging import measure_merging
from studies.offsets import measure_offsets
from studies.paper import measure_paper
from studies.passages import measure_passages
from studies.physics import check_laws
from studies.pose_graphs import measure_pose_graphs
from studies.real_rooms import measure_real_rooms
from studies.realism import measure_realism
from studies.sensitivity import measure_sensitivity
from studies.sensors import compare_sensors
from studies.speech import measure_speech
from studies.speed import measure_speed
from studies.spots import measure_spots
from studies.superimposition import measure_superimposition
from studies.taps import measure_taps
from studies.thresholds import measure_thresholds
from studies.trace import measure_trace
from studies.unknown_phone import measure_unknown_phone

STUDIES: Mapping[str, Study | LongStudy] = {
    "acoustic-odometry": LongStudy(measure_acoustic_odometry),
    "amounts": LongStudy(measure_amounts),
    "attacks": LongStudy(measure_attacks),
    "closures": LongStudy(measure_closure_steps),
    "dead-reckoning": measure_dead_reckoning,
    "distinctness": measure_distinctness,
    "elf": measure_elf,
    "fidelity": compare_engines,
    "finetuning": measure_finetuning,
    "fix-thresholds": LongStudy(measure_fix_thresholds),
    "floor-plan": LongStudy(measure_floor_plan),
    "laps": LongStudy(measure_laps),
    "localization": LongStudy(measure_localization),
    "localization-cost": measure_localization_cost,
    "magnetic-left-out": LongStudy(measure_magnetic_left_out),
    "magnetic-walks": measure_magnetic_walks,
    "mall-fifths": LongStudy(measure_mall_fifths),
    "mall-floor": measure_mall_floor,
    "many-mappers": LongStudy(measure_many_mappers),
    "mapping": LongStudy(measure_mapping),
    "merging": LongStudy(measure_merging),
    "offsets": measure_offsets,
    "paper": LongStudy(measure_paper),
    "passages": LongStudy(measure_passages),
    "physics": check_laws,
    "pose-graphs": LongStudy(measure_pose_graphs),
    "real-rooms": measure_real_rooms,
    "displacement": measure_displacement,
    "realism": measure_realism,
    "sensitivity": LongStudy(measure_sensitivity),
    "sensors": compare_sensors,
    "speech": measure_speech,
    "speed": measure_speed,
    "spots": LongStudy(measure_spots),
    "superimposition": LongStudy(measure_superimposition),
    "taps": LongStudy(measure_taps),
    "thresholds": LongStudy(measure_thresholds),
    "trace": measure_trace,
    "contention": LongStudy(measure_contention),
    "unknown-phone": LongStudy(measure_unknown_phone),
}


COMPARES = ("displacement", "elf", "laps", "real-rooms", "trace")
"""Studies to which encoders can be given."""
OF_SURVEYORS = ("amounts", "elf", "finetuning", "merging", "superimposition", "unknown-phone")
BY_KIND = (
    "acoustic-odometry", "closures", "floor-plan", "laps", "localization", "many-mappers",
    "mapping", "passages", "sensitivity", "taps", *OF_SURVEYORS,
)  # fmt: skip
"""Studies whose walks are of a kind: people's where none is given, or surveyors'."""


def run_study(
    name: str,
    out: Path,
    data: Path | None,
    announce: Announce,
    *,
    encoders: Mapping[str, Encoder] | None = None,
    kind: str | None = None,
    on: str | None = None,
) -> list[Row]:
    """The rows of a study, also written to `out` as name.json and name.csv (and name.html).

    A long one keeps what is finished in name.partial until then, so that it goes on after a kill.
    `encoders` are measured by name, in place of those that the study would measure or beside them,
    and `kind` is that of the walks. `on` says who works on a long one, as `open_workers` has it.
    Raises InputError for a study that does not exist, compares no encoders, is of no kind, or is
    too short to be shared out; ParameterError for a kind that does not exist.
    """
    if name not in STUDIES:
        raise InputError(f"study {name!r}: wanted {', '.join(STUDIES)}; no such study")
    kept = out / f"{name}.partial"
    with _workers_for(name, on) as workers:
        chosen = _chosen(name, encoders or {}, kind)
        study = STUDIES[name]
        measure = study.measure if isinstance(study, LongStudy) else study
        made = measure(Given(data, announce, kept, workers), **chosen)
    finding = made if isinstance(made, Finding) else Finding(made)
    rows = finding.rows
    with replaced_file(out / f"{name}.json") as partial:
        partial.write_text(json.dumps(rows, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    with replaced_file(out / f"{name}.csv") as partial:
        _write_csv(partial, rows)
    if finding.page is not None:
        with replaced_file(out / f"{name}.html") as partial:
            save_page(partial, finding.page)
    kept.unlink(missing_ok=True)
    return rows


@contextmanager
def _workers_for(name: str, on: str | None) -> Iterator[Workers]:
    if on is not None and not isinstance(STUDIES[name], LongStudy):
        raise InputError(f"study {name}: is short and runs in this process; leave --on out")
    with open_workers(on) as workers:
        yield workers


def _chosen(name: str, encoders: Mapping[str, Encoder], kind: str | None) -> dict[str, Any]:
    """What the study is told beside the data."""
    if encoders and name not in COMPARES:
        raise InputError(f"study {name}: compares no encoders, only {', '.join(COMPARES)} do")
    if kind is not None and name not in BY_KIND:
        raise InputError(f"study {name}: is of no kind, only {', '.join(BY_KIND)} are")
    chosen: dict[str, Any] = {} if kind is None else {"kind": kind_named(kind)}
    return chosen | ({"encoders": encoders} if encoders else {})


def _write_csv(file: Path, rows: list[Row]) -> None:
    names = list(dict.fromkeys(name for row in rows for name in row))
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, fieldnames=names, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
