"""The schema before versions were kept; databases of that time are adopted, missing tables made."""

from typing import Any

import sqlalchemy as sa
from alembic import op
from sqlalchemy import BigInteger, Boolean, Column, Double, Index, Integer, String

revision, down_revision = "0001", None
branch_labels = depends_on = None

TABLES = sa.MetaData()
TIME = sa.DateTime(timezone=True)


def needed(kind: Any, *names: str) -> list[Column[Any]]:
    """Columns of one type that every row fills."""
    return [Column(name, kind, nullable=False) for name in names]


def optional(kind: Any, *names: str) -> list[Column[Any]]:
    """Columns of one type that may be empty."""
    return [Column(name, kind) for name in names]


def part_of(name: str, other: str, **how: Any) -> Column[Any]:
    """What names a row of another table, with which this row goes."""
    kind = Integer if other.endswith(".number") else String
    return Column(name, kind, sa.ForeignKey(other, ondelete="CASCADE"), **how)


def user() -> Column[Any]:
    """Whose it is."""
    return part_of("user_id", "users.id", nullable=False, index=True)


sa.Table(
    "buildings",
    TABLES,
    Column("number", Integer, primary_key=True),
    Column("name", String, nullable=False, unique=True),
)
sa.Table(
    "users",
    TABLES,
    Column("id", String, primary_key=True),
    *needed(String, "name"),
    Column("token_sha256", String, nullable=False, unique=True, index=True),
    *needed(Boolean, "is_owner"),
    *needed(TIME, "created_utc"),
)
sa.Table(
    "floors",
    TABLES,
    Column("number", Integer, primary_key=True),
    Column("id", String, nullable=False, unique=True),
    Column("building", Integer, sa.ForeignKey("buildings.number"), nullable=False),
    *needed(Integer, "level"),
    *needed(Double, "latitude_deg", "longitude_deg", "radius_m"),
    *optional(Double, "altitude_m"),
    *needed(Boolean, "has_wifi"),
    *needed(BigInteger, "revision"),
    *needed(sa.Text, "manifest"),
    *needed(TIME, "published_utc"),
    sa.UniqueConstraint("building", "level"),
    Index("floors_by_place", "latitude_deg", "longitude_deg"),
)
sa.Table(
    "jobs",
    TABLES,
    Column("id", String, primary_key=True),
    user(),
    *needed(String, "kind"),
    Column("state", String, nullable=False, index=True),
    *needed(sa.JSON, "given", "gave"),
    *needed(String, "doing"),
    *optional(Double, "share"),
    *needed(Integer, "attempts"),
    *optional(String, "claim", "problem"),
    *needed(TIME, "created_utc"),
    *optional(TIME, "started_utc", "finished_utc"),
)
sa.Table(
    "maps",
    TABLES,
    Column("id", String, primary_key=True),
    user(),
    *needed(String, "name", "kind"),
    *needed(sa.JSON, "sources", "facts"),
    *optional(sa.JSON, "floor_plan"),
    *needed(TIME, "created_utc"),
)
sa.Table(
    "recordings",
    TABLES,
    Column("id", String, primary_key=True),
    user(),
    *needed(String, "name", "device", "state"),
    *optional(String, "refusal"),
    *needed(sa.JSON, "facts"),
    *needed(TIME, "created_utc"),
)
sa.Table(
    "floor_points",
    TABLES,
    Column("bssid", BigInteger, primary_key=True, autoincrement=False),
    part_of("floor", "floors.number", primary_key=True, index=True),
    *needed(sa.REAL, "level_dbm", "spread_db", "share"),
)
sa.Table(
    "map_packages",
    TABLES,
    part_of("map_id", "maps.id", primary_key=True),
    *needed(String, "sources_sha256"),
    *needed(BigInteger, "revision"),
    *needed(String, "manifest"),
)
for part, name, other in (
    ("floor_parts", "floor", "floors.number"),
    ("map_parts", "map_id", "maps.id"),
):
    sa.Table(
        part,
        TABLES,
        part_of(name, other, primary_key=True),
        Column("sha256", String, primary_key=True, index=True),
        *needed(BigInteger, "size_bytes"),
    )
for owner in ("job", "map", "recording"):
    sa.Table(
        f"{owner}_files",
        TABLES,
        part_of(f"{owner}_id", f"{owner}s.id", primary_key=True),
        Column("name", String, primary_key=True),
        Column("sha256", String, nullable=False, index=True),
        *needed(BigInteger, "size_bytes"),
    )
sa.Table(
    "uploads",
    TABLES,
    Column("id", String, primary_key=True),
    user(),
    part_of("recording_id", "recordings.id", index=True),
    *needed(String, "file_name"),
    *optional(BigInteger, "length_bytes"),
    *needed(Boolean, "wants_map", "finished"),
    *needed(TIME, "created_utc"),
)


def upgrade() -> None:
    """From nothing, or from tables without a version."""
    TABLES.create_all(op.get_bind())
