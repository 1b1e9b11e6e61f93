"""Offsets in small: a row for each way and axis."""

from __future__ import annotations

import pytest

from studies.finding import Given
from studies.offset_ways import LEARNT
from studies.offsets import AXES, CLAIMED, measure_offsets


@pytest.mark.real
def test_a_room_has_a_row_for_each_way_and_axis() -> None:
    finding = measure_offsets(
        Given(), worlds=("studio",), seeds=(101, 102), development=("lounge",), learnt_seeds=(100,)
    )
    ways = [CLAIMED, *LEARNT]
    assert [(row["way"], row["axis"]) for row in finding.rows] == [
        (way, axis) for way in ways for axis in AXES
    ]
    across = {row["way"]: row["missed (rms)"] for row in finding.rows if row["axis"] == AXES[1]}
    assert across[CLAIMED] == across["zero, by likeness"]
    assert finding.page is not None
