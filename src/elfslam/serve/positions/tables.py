"""Positions in the database: each walker's history, a map's settings, and its webhooks."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy import BigInteger, ForeignKey, Index, Integer
from sqlalchemy.orm import Mapped, mapped_column

from elfslam.serve.store.database import Base, new_id, now_utc

NUMBER = BigInteger().with_variant(Integer, "sqlite")
"""SQLite counts up whole numbers of this type alone."""


class KeptPosition(Base):
    """Where somebody was. `map_id` is that of a map, or of a published floor."""

    __tablename__ = "positions"
    __table_args__ = (Index("positions_of_user", "user_id", "time_utc"),)
    number: Mapped[int] = mapped_column(NUMBER, primary_key=True, autoincrement=True)
    user_id: Mapped[str] = mapped_column(ForeignKey("users.id", ondelete="CASCADE"))
    map_id: Mapped[str] = mapped_column(index=True)
    walk: Mapped[str]
    time_utc: Mapped[datetime] = mapped_column(index=True)
    status: Mapped[str]
    x_m: Mapped[float | None]
    y_m: Mapped[float | None]
    heading_rad: Mapped[float | None]
    sigma_m: Mapped[float | None]
    latitude_deg: Mapped[float | None]
    longitude_deg: Mapped[float | None]


class MapPositions(Base):
    """Whether a map takes positions (without a row it does), and where on the Earth it lies."""

    __tablename__ = "map_positions"
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id", ondelete="CASCADE"), primary_key=True)
    is_on: Mapped[bool] = mapped_column(default=True)
    latitude_deg: Mapped[float | None] = mapped_column(default=None)
    longitude_deg: Mapped[float | None] = mapped_column(default=None)
    bearing_deg: Mapped[float | None] = mapped_column(default=None)


class Webhook(Base):
    """Where positions in a map are posted to. The secret signs them, so it is kept as it is."""

    __tablename__ = "webhooks"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id", ondelete="CASCADE"), index=True)
    url: Mapped[str]
    secret: Mapped[str]
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)
