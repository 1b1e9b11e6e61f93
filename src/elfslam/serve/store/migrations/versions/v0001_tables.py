"""The schema before versions were kept; databases of that time are adopted, missing tables made."""

from alembic import op
from sqlalchemy import (
    JSON,
    REAL,
    BigInteger,
    Boolean,
    Column,
    DateTime,
    Double,
    ForeignKeyConstraint,
    Index,
    Integer,
    MetaData,
    PrimaryKeyConstraint,
    String,
    Table,
    Text,
    UniqueConstraint,
)

revision, down_revision = "0001", None
branch_labels = depends_on = None

TABLES = MetaData()
TIME = DateTime(timezone=True)

Table(
    "buildings",
    TABLES,
    Column("number", Integer(), nullable=False),
    Column("name", String(), nullable=False),
    PrimaryKeyConstraint("number"),
    UniqueConstraint("name"),
)
Table(
    "users",
    TABLES,
    Column("id", String(), nullable=False),
    Column("name", String(), nullable=False),
    Column("token_sha256", String(), nullable=False),
    Column("is_owner", Boolean(), nullable=False),
    Column("created_utc", TIME, nullable=False),
    PrimaryKeyConstraint("id"),
    Index("ix_users_token_sha256", "token_sha256", unique=True),
)
Table(
    "floors",
    TABLES,
    Column("number", Integer(), nullable=False),
    Column("id", String(), nullable=False),
    Column("building", Integer(), nullable=False),
    Column("level", Integer(), nullable=False),
    Column("latitude_deg", Double(), nullable=False),
    Column("longitude_deg", Double(), nullable=False),
    Column("radius_m", Double(), nullable=False),
    Column("altitude_m", Double(), nullable=True),
    Column("has_wifi", Boolean(), nullable=False),
    Column("revision", BigInteger(), nullable=False),
    Column("manifest", Text(), nullable=False),
    Column("published_utc", TIME, nullable=False),
    ForeignKeyConstraint(["building"], ["buildings.number"]),
    PrimaryKeyConstraint("number"),
    UniqueConstraint("building", "level"),
    UniqueConstraint("id"),
    Index("floors_by_place", "latitude_deg", "longitude_deg"),
)
Table(
    "jobs",
    TABLES,
    Column("id", String(), nullable=False),
    Column("user_id", String(), nullable=False),
    Column("kind", String(), nullable=False),
    Column("state", String(), nullable=False),
    Column("given", JSON(), nullable=False),
    Column("gave", JSON(), nullable=False),
    Column("doing", String(), nullable=False),
    Column("share", Double(), nullable=True),
    Column("attempts", Integer(), nullable=False),
    Column("claim", String(), nullable=True),
    Column("problem", String(), nullable=True),
    Column("created_utc", TIME, nullable=False),
    Column("started_utc", TIME, nullable=True),
    Column("finished_utc", TIME, nullable=True),
    ForeignKeyConstraint(["user_id"], ["users.id"], ondelete="CASCADE"),
    PrimaryKeyConstraint("id"),
    Index("ix_jobs_state", "state"),
    Index("ix_jobs_user_id", "user_id"),
)
Table(
    "maps",
    TABLES,
    Column("id", String(), nullable=False),
    Column("user_id", String(), nullable=False),
    Column("name", String(), nullable=False),
    Column("kind", String(), nullable=False),
    Column("sources", JSON(), nullable=False),
    Column("facts", JSON(), nullable=False),
    Column("floor_plan", JSON(), nullable=True),
    Column("created_utc", TIME, nullable=False),
    ForeignKeyConstraint(["user_id"], ["users.id"], ondelete="CASCADE"),
    PrimaryKeyConstraint("id"),
    Index("ix_maps_user_id", "user_id"),
)
Table(
    "recordings",
    TABLES,
    Column("id", String(), nullable=False),
    Column("user_id", String(), nullable=False),
    Column("name", String(), nullable=False),
    Column("device", String(), nullable=False),
    Column("state", String(), nullable=False),
    Column("refusal", String(), nullable=True),
    Column("facts", JSON(), nullable=False),
    Column("created_utc", TIME, nullable=False),
    ForeignKeyConstraint(["user_id"], ["users.id"], ondelete="CASCADE"),
    PrimaryKeyConstraint("id"),
    Index("ix_recordings_user_id", "user_id"),
)
Table(
    "floor_parts",
    TABLES,
    Column("floor", Integer(), nullable=False),
    Column("sha256", String(), nullable=False),
    Column("size_bytes", BigInteger(), nullable=False),
    ForeignKeyConstraint(["floor"], ["floors.number"], ondelete="CASCADE"),
    PrimaryKeyConstraint("floor", "sha256"),
    Index("ix_floor_parts_sha256", "sha256"),
)
Table(
    "floor_points",
    TABLES,
    Column("bssid", BigInteger(), autoincrement=False, nullable=False),
    Column("floor", Integer(), nullable=False),
    Column("level_dbm", REAL(), nullable=False),
    Column("spread_db", REAL(), nullable=False),
    Column("share", REAL(), nullable=False),
    ForeignKeyConstraint(["floor"], ["floors.number"], ondelete="CASCADE"),
    PrimaryKeyConstraint("bssid", "floor"),
    Index("ix_floor_points_floor", "floor"),
)
Table(
    "job_files",
    TABLES,
    Column("job_id", String(), nullable=False),
    Column("name", String(), nullable=False),
    Column("sha256", String(), nullable=False),
    Column("size_bytes", BigInteger(), nullable=False),
    ForeignKeyConstraint(["job_id"], ["jobs.id"], ondelete="CASCADE"),
    PrimaryKeyConstraint("job_id", "name"),
    Index("ix_job_files_sha256", "sha256"),
)
Table(
    "map_files",
    TABLES,
    Column("map_id", String(), nullable=False),
    Column("name", String(), nullable=False),
    Column("sha256", String(), nullable=False),
    Column("size_bytes", BigInteger(), nullable=False),
    ForeignKeyConstraint(["map_id"], ["maps.id"], ondelete="CASCADE"),
    PrimaryKeyConstraint("map_id", "name"),
    Index("ix_map_files_sha256", "sha256"),
)
Table(
    "map_packages",
    TABLES,
    Column("map_id", String(), nullable=False),
    Column("sources_sha256", String(), nullable=False),
    Column("revision", BigInteger(), nullable=False),
    Column("manifest", String(), nullable=False),
    ForeignKeyConstraint(["map_id"], ["maps.id"], ondelete="CASCADE"),
    PrimaryKeyConstraint("map_id"),
)
Table(
    "map_parts",
    TABLES,
    Column("map_id", String(), nullable=False),
    Column("sha256", String(), nullable=False),
    Column("size_bytes", BigInteger(), nullable=False),
    ForeignKeyConstraint(["map_id"], ["maps.id"], ondelete="CASCADE"),
    PrimaryKeyConstraint("map_id", "sha256"),
    Index("ix_map_parts_sha256", "sha256"),
)
Table(
    "recording_files",
    TABLES,
    Column("recording_id", String(), nullable=False),
    Column("name", String(), nullable=False),
    Column("sha256", String(), nullable=False),
    Column("size_bytes", BigInteger(), nullable=False),
    ForeignKeyConstraint(["recording_id"], ["recordings.id"], ondelete="CASCADE"),
    PrimaryKeyConstraint("recording_id", "name"),
    Index("ix_recording_files_sha256", "sha256"),
)
Table(
    "uploads",
    TABLES,
    Column("id", String(), nullable=False),
    Column("user_id", String(), nullable=False),
    Column("recording_id", String(), nullable=True),
    Column("file_name", String(), nullable=False),
    Column("length_bytes", BigInteger(), nullable=True),
    Column("wants_map", Boolean(), nullable=False),
    Column("finished", Boolean(), nullable=False),
    Column("created_utc", TIME, nullable=False),
    ForeignKeyConstraint(["recording_id"], ["recordings.id"], ondelete="CASCADE"),
    ForeignKeyConstraint(["user_id"], ["users.id"], ondelete="CASCADE"),
    PrimaryKeyConstraint("id"),
    Index("ix_uploads_recording_id", "recording_id"),
    Index("ix_uploads_user_id", "user_id"),
)


def upgrade() -> None:
    """From nothing, or from tables without a version."""
    TABLES.create_all(op.get_bind())
