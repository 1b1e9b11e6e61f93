"""What the study of a long queue shows: a row per milestone, and the driver's memory as it goes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from elfslam.scoring.page import Page, Panel, rows_table
from studies.figures.curves import Curve, curves_figure
from studies.finding import Row

MILESTONES = (0.1, 0.5, 1.0)
"""Shares of the jobs at which the driver is looked at."""
NOTE_MEMORY = (
    "Resident memory of the process that gives out the work. It begins anew where it was killed."
)
NOTE_DONE = "Runs that lie on the disk. A driver that was killed is started again at once."


@dataclass
class Kept:
    """What is known so far: (driver, seconds, runs, MiB) now and then, and who was killed.

    `before_kill` says by name which file each run was when the driver was killed; `refused` is
    the exit status of a driver that ended by itself.
    """

    samples: list[list[float]] = field(default_factory=list)
    drivers: int = 0
    workers_killed: int = 0
    before_kill: dict[str, list[int]] = field(default_factory=dict)
    refused: int = 0


def queue_rows(known: Kept, jobs: int, judged: Mapping[str, int]) -> list[Row]:
    """A row per milestone; the last says what was lost, done again, and came out differently.

    `runs/s` is that since the milestone before.
    """
    rows: list[Row] = []
    before_s = before = 0.0
    for share in MILESTONES:
        _, t_s, done, rss_mib = _at(known.samples, share * jobs)
        last = share == MILESTONES[-1]
        rows.append(
            {
                "runs": int(done),
                "wall (s)": round(t_s, 1),
                "runs/s": round((done - before) / max(t_s - before_s, 1e-9), 2),
                "driver (MiB)": round(rss_mib, 1),
                **{name: count if last else None for name, count in judged.items()},
            }
        )
        before_s, before = t_s, done
    return rows


def _at(samples: Sequence[Sequence[float]], done: float) -> Sequence[float]:
    """The first sample with so many runs done, or the last of which the memory is known."""
    known = [sample for sample in samples if sample[3] > 0]
    return next((sample for sample in known if sample[2] >= done), known[-1])


def queue_page(known: Kept, rows: Sequence[Row]) -> Page:
    """The driver's memory over the runs that are done, and these over time."""
    samples = np.array(known.samples)
    memory = {
        f"driver {number:.0f}": Curve(*samples[samples[:, 0] == number][:, [2, 3]].T)
        for number in np.unique(samples[:, 0])
    }
    done = {"runs": Curve(samples[:, 1] / 60, samples[:, 2])}
    panels = [
        Panel("Memory", curves_figure(memory, "runs done", "resident (MiB)"), NOTE_MEMORY),
        Panel("Progress", curves_figure(done, "minutes", "runs done"), NOTE_DONE),
        Panel("Milestones", rows_table(rows), wide=True),
    ]
    tiles = {
        "runs": f"{rows[-1]['runs']:,}",
        "minutes": f"{samples[-1, 1] / 60:.1f}",
        "lost": str(rows[-1]["lost"]),
        "done again": str(rows[-1]["done again"]),
        "drivers": str(known.drivers),
        "workers killed": str(known.workers_killed),
    }
    return Page("A long queue", "Many short walks mapped by one command.", panels, tiles)
