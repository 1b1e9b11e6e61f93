"""What can be told of the offset between two footsteps that sound alike, and how honestly.

A closure claims that two footsteps are one place. Whoever could say by how much they are not would
give every closure a relative pose of its own. Ways to tell it are learnt from people's laps in the
development worlds and told of others, who have another phone on another day.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from elfslam.base.arrays import F64
from elfslam.line.feature import load_encoder
from elfslam.scoring.page import Page, Panel, rows_table
from elfslam.world.kinds import PEOPLE
from studies.figures.dots import dots_by, dots_figure
from studies.finding import Finding, Given, Row
from studies.intervals import mean_interval
from studies.offset_pairs import Pairs, pairs_in, together
from studies.offset_ways import LEARNT, Teller, as_the_line_claims

WORLDS, SEEDS = ("living_room", "office", "mall"), tuple(range(5))
DEVELOPMENT, LEARNT_SEEDS = ("studio", "lounge", "concourse"), tuple(range(100, 105))
AXES = ("along (m)", "across (m)", "heading (rad)")
CLAIMED = "zero, a closure's sigma"
NOTE = "Root mean square of what is missed, mean over seeds with its 95 % interval."


def measure_offsets(
    given: Given,
    *,
    worlds: Sequence[str] = WORLDS,
    seeds: Sequence[int] = SEEDS,
    development: Sequence[str] = DEVELOPMENT,
    learnt_seeds: Sequence[int] = LEARNT_SEEDS,
) -> Finding:
    """A row per world, way and axis: what is missed, and whether sigmas say so."""
    known = together(_pairs(given, development, learnt_seeds).values())
    given.announce("learning", 0.5)
    ways: dict[str, Teller] = {CLAIMED: as_the_line_claims}
    ways |= {name: learn(known) for name, learn in LEARNT.items()}
    asked = _pairs(given, worlds, seeds)
    rows = [
        row
        for world in worlds
        for name, tell in ways.items()
        for row in _rows(world, name, [_missed(tell, asked[world, seed]) for seed in seeds])
    ]
    return Finding(rows, _page(rows))


def _pairs(
    given: Given, worlds: Sequence[str], seeds: Sequence[int]
) -> Mapping[tuple[str, int], Pairs]:
    encoder, found = load_encoder("compact"), dict[tuple[str, int], Pairs]()
    for world in worlds:
        for seed in seeds:
            given.announce(f"{world.replace('_', ' ')}, seed {seed}", None)
            found[world, seed] = pairs_in(world, PEOPLE.name, encoder, seed)
    return found


def _missed(tell: Teller, pairs: Pairs) -> F64:
    """What is missed of each axis, and its sigma: (2, n, 3)."""
    told = tell(pairs)
    return np.stack([pairs.offset - told.mean, told.sigma])


def _rows(world: str, way: str, seeds: Sequence[F64]) -> list[Row]:
    return [
        _row(world, way, axis, [missed[..., k] for missed in seeds]) for k, axis in enumerate(AXES)
    ]


def _row(world: str, way: str, axis: str, seeds: Sequence[F64]) -> Row:
    each = [float(np.sqrt(np.mean(missed**2))) for missed, _ in seeds]
    low, high = mean_interval(each)
    missed, sigma = np.concatenate(seeds, axis=1)
    return {
        "world": world, "way": way, "axis": axis, "missed (rms)": round(float(np.mean(each)), 3),
        "from": low, "to": high,
        "within one sigma": round(float(np.mean(np.abs(missed) <= sigma)), 3),
        "NEES": round(float(np.mean((missed / sigma) ** 2)), 2),
        "log likelihood": round(float(np.mean(-0.5 * (missed / sigma) ** 2 - np.log(sigma))), 3),
        "pairs": len(missed),
    }  # fmt: skip


def _page(rows: Sequence[Row]) -> Page:
    panels = [
        Panel(
            axis,
            dots_figure(
                dots_by(
                    lambda row: str(row["world"]).replace("_", " "), lambda row: str(row["way"]),
                    [row for row in rows if row["axis"] == axis], "missed (rms)", "from", "to",
                ),
                f"missed {axis}", "",
            ),
            NOTE,
            wide=True,
        )
        for axis in AXES
    ]  # fmt: skip
    return Page(
        "Offsets between footsteps that sound alike",
        "people in lanes, another phone on another day",
        [*panels, Panel("Figures", rows_table(rows), wide=True)],
    )
