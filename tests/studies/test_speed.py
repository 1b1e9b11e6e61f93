"""The speed study on a small scale: its rows, not its figures."""

from __future__ import annotations

from studies.finding import Given
from studies.speed import TIMES_FASTER, measure_speed


def test_every_rate_and_every_goal_has_a_row() -> None:
    heard: list[float | None] = []
    given = Given(announce=lambda what, share: heard.append(share))
    rows = measure_speed(given, echoes=40, stream=600)
    values = {str(row["quantity"]): row["value"] for row in rows}
    assert all(isinstance(value, float) and value > 0 for value in values.values())
    ours, theirs = (
        values[f"living room, empty, {engine}"] for engine in ("ours", "pyroomacoustics with air")
    )
    assert isinstance(ours, float)
    assert isinstance(theirs, float)
    ratio = values["empty: ours over pyroomacoustics with air"]
    assert isinstance(ratio, float)
    assert abs(ratio / (ours / theirs) - 1) < 0.01
    assert [row["goal"] for row in rows].count(TIMES_FASTER) == 2
    for engine in ("images", "diffuse"):
        assert f"600 training echoes by {engine}, spectrograms, 2 cores" in values
    rays = "pyroomacoustics, as many rays, empty room"
    assert values["diffuse field over rays"] > 1 > values[rays] / 1000
    assert heard[0] == 0.0
