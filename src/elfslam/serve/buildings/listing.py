"""What is published, for people."""

from __future__ import annotations

from sqlalchemy import func, select

from elfslam.serve.buildings.tables import Building, Floor, FloorPart, FloorPoint
from elfslam.serve.services import Services
from elfslam.serve.store.database import reading


def published_rows(services: Services) -> list[dict[str, object]]:
    """A row a floor: building, floor, where it lies, its map, and how much that takes."""
    parts = select(func.count(), func.sum(FloorPart.size_bytes)).where(
        FloorPart.floor == Floor.number
    )
    points = select(func.count()).where(FloorPoint.floor == Floor.number)
    columns = (
        Building.name, Floor.level, Floor.latitude_deg, Floor.longitude_deg, Floor.id,
        Floor.revision, points.scalar_subquery(),
        parts.with_only_columns(func.sum(FloorPart.size_bytes)).scalar_subquery(),
    )  # fmt: skip
    wanted = select(*columns).join(Building).order_by(Building.name, Floor.level)
    with reading(services.sessions) as session:
        return [
            {
                "building": name,
                "floor": level,
                "at": f"{latitude:.6f},{longitude:.6f}",
                "map": map_id,
                "revision": revision,
                "access points": points,
                "bytes": size,
            }
            for name, level, latitude, longitude, map_id, revision, points, size in session.execute(
                wanted
            )
        ]
