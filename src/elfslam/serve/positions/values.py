"""A walker's position: as it is sent, and as it is told to others."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from elfslam.base.bounds import FARTHEST_M
from elfslam.data.geographic import EAST_DEG, HIGHEST_DEG, Origin, to_lon_lat
from elfslam.serve.texts import Id, Metres

Status = Literal["OK", "AMBIGUOUS", "UNKNOWN_PLACE", "NO_ECHO", "SUSPECT"]
"""The names of `FixStatus`."""
OLDEST_S = 60.0
MOST_AT_ONCE = 20
"""Positions in a request: ten seconds' worth."""
DIGITS_M, DIGITS_RAD, DIGITS_DEG = 3, 4, 8
"""A millimetre, here and on the Earth; a hundredth of a degree."""
WalkId = Annotated[str, Field(pattern=r"^[0-9a-f]{8,32}$")]


class NewPosition(BaseModel):
    """A fix, `age_s` before it is sent. `sigma_m` is per axis; what is not known is left out."""

    age_s: float = Field(0.0, ge=0, le=OLDEST_S, allow_inf_nan=False)
    status: Status
    x_m: Metres | None = None
    y_m: Metres | None = None
    heading_rad: float | None = Field(None, ge=-100, le=100, allow_inf_nan=False)
    sigma_m: float | None = Field(None, ge=0, le=FARTHEST_M, allow_inf_nan=False)

    @model_validator(mode="after")
    def _both_or_neither(self) -> NewPosition:
        if (self.x_m is None) != (self.y_m is None):
            raise ValueError("wanted both x_m and y_m or neither, got one of them")
        return self


class NewPositions(BaseModel):
    """What a walker tells of where they are. `walk` is drawn anew for every walk."""

    map: Id
    walk: WalkId
    positions: list[NewPosition] = Field(max_length=MOST_AT_ONCE)
    is_over: bool = False
    """Consent has ended: what is shown of this walk goes at once."""


class LivePosition(BaseModel):
    """Where a walker is: in metres of the map, and on the Earth where the map is placed there."""

    model_config = ConfigDict(frozen=True)

    map: str
    walker: str
    name: str
    walk: str
    time_utc: datetime
    status: Status
    x_m: float | None = None
    y_m: float | None = None
    heading_rad: float | None = None
    sigma_m: float | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None


class MapOrigin(BaseModel):
    """Where a map's origin lies, and where its x axis points, clockwise from north."""

    latitude_deg: float = Field(ge=-HIGHEST_DEG, le=HIGHEST_DEG, allow_inf_nan=False)
    longitude_deg: float = Field(ge=-180, le=180, allow_inf_nan=False)
    bearing_deg: float = Field(EAST_DEG, ge=-360, le=360, allow_inf_nan=False)


def told_of(
    given: NewPositions, walker: str, name: str, now_utc: datetime, origin: MapOrigin | None
) -> list[LivePosition]:
    """What others are told of positions that a walker sent, oldest first."""
    oldest_first = sorted(given.positions, key=lambda each: -each.age_s)
    places = _on_earth(oldest_first, origin)
    return [
        LivePosition(
            map=given.map,
            walker=walker,
            name=name,
            walk=given.walk,
            time_utc=now_utc.astimezone(UTC) - timedelta(seconds=each.age_s),
            status=each.status,
            x_m=_rounded(each.x_m, DIGITS_M),
            y_m=_rounded(each.y_m, DIGITS_M),
            heading_rad=_rounded(each.heading_rad, DIGITS_RAD),
            sigma_m=_rounded(each.sigma_m, DIGITS_M),
            latitude_deg=latitude_deg,
            longitude_deg=longitude_deg,
        )
        for each, (longitude_deg, latitude_deg) in zip(oldest_first, places, strict=True)
    ]


def _on_earth(
    positions: Sequence[NewPosition], origin: MapOrigin | None
) -> list[tuple[float, float] | tuple[None, None]]:
    """Longitude and latitude of each; none of a map that nobody has placed, nor without a place."""
    if origin is None or not positions:
        return [(None, None)] * len(positions)
    missing = float("nan")
    xy_m = [[missing if v is None else v for v in (p.x_m, p.y_m)] for p in positions]
    degrees = to_lon_lat(Origin(**origin.model_dump()), np.array(xy_m)).round(DIGITS_DEG)
    return [(None, None) if np.isnan(row).any() else (row[0], row[1]) for row in degrees.tolist()]


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None else round(value, digits)
