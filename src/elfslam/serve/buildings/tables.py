"""Published floors in the database: where they lie, what is heard there, and their packages.

Parts of packages lie apart (`files.py`), by their SHA-256.
"""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import REAL, BigInteger, ForeignKey, Index, Text, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from elfslam.serve.store.database import Base, new_id, now_utc


class Building(Base):
    """A building by its name."""

    __tablename__ = "buildings"
    number: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)


class Floor(Base):
    """A floor and the map of it that phones get; `id` stays while revisions come and go.

    `level` is 0 on the ground. The disc around the middle holds all spots of the map.
    """

    __tablename__ = "floors"
    __table_args__ = (
        UniqueConstraint("building", "level"),
        Index("floors_by_place", "latitude_deg", "longitude_deg"),
    )
    number: Mapped[int] = mapped_column(primary_key=True)
    id: Mapped[str] = mapped_column(unique=True, default=new_id)
    building: Mapped[int] = mapped_column(ForeignKey("buildings.number"))
    level: Mapped[int]
    latitude_deg: Mapped[float]
    longitude_deg: Mapped[float]
    radius_m: Mapped[float]
    altitude_m: Mapped[float | None] = mapped_column(default=None)
    has_wifi: Mapped[bool]
    revision: Mapped[int] = mapped_column(BigInteger)
    manifest: Mapped[str] = mapped_column(Text)
    published_utc: Mapped[datetime] = mapped_column(default=now_utc)


class FloorPart(Base):
    """A file of a floor's package."""

    __tablename__ = "floor_parts"
    floor: Mapped[int] = mapped_column(
        ForeignKey("floors.number", ondelete="CASCADE"), primary_key=True
    )
    sha256: Mapped[str] = mapped_column(primary_key=True, index=True)
    size_bytes: Mapped[int] = mapped_column(BigInteger)


class FloorPoint(Base):
    """An access point that is heard on a floor; found by its address, 48 bits."""

    __tablename__ = "floor_points"
    bssid: Mapped[int] = mapped_column(BigInteger, primary_key=True, autoincrement=False)
    floor: Mapped[int] = mapped_column(
        ForeignKey("floors.number", ondelete="CASCADE"), primary_key=True, index=True
    )
    level_dbm: Mapped[float] = mapped_column(REAL)
    spread_db: Mapped[float] = mapped_column(REAL)
    share: Mapped[float] = mapped_column(REAL)
