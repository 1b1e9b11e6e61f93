"""What the server remembers: users, recordings, uploads, jobs, maps, with whom those are shared,
where walkers were, and published floors, in one SQL database.

Files lie beside it, content-addressed (`blobs.py`); rows name them by their SHA-256. Parts of the
packages of published floors lie apart (`buildings/files.py`).
"""

import uuid
from datetime import UTC, datetime
from enum import StrEnum
from typing import Annotated, Any, Literal, TypedDict

import sqlalchemy as sa
from sqlalchemy.orm import DeclarativeBase, Mapped, MappedColumn, mapped_column
from sqlalchemy.types import TypeDecorator


class RecordingState(StrEnum):
    """How far a recording has come."""

    RECEIVING = "receiving"
    READY = "ready"
    REFUSED = "refused"


class JobKind(StrEnum):
    """What a job does."""

    MAP = "map"
    MERGE = "merge"
    LOCATE = "locate"


class JobState(StrEnum):
    """How far a job has come."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


class RecordingFacts(TypedDict, total=False):
    """What is told of a recording: what its reader found in it, and where it came from."""

    name: str
    device: str
    audio: dict[str, int]
    sensors: list[str]
    duration_s: float
    start_pose: list[float]
    spans_s: dict[str, list[list[float]]]
    notes: list[str]
    footsteps: int
    tapped_on: str
    """The map on whose plan its walker tapped."""
    imported: str
    chirps: bool
    damaged_lines: int
    bytes: int


class MapFacts(TypedDict, total=False):
    """What is told of a map, of one walk or merged: what its job found."""

    walks: int
    footsteps: int
    spots: int
    duration_s: float
    distance_m: float
    closures: int
    closures_kept: int
    status: str
    by: str
    pairs: list[dict[str, object]]
    refused: dict[str, str]
    bounds_m: list[float]
    kept_s: list[float]
    heading: str
    missing: Any
    """Stretches in which the recording lacked sound or motion."""
    frame: str
    """The map whose frame a merged one has, or a floor of a building: that of its lowest."""
    level: int
    """Of a floor of a building, as are its height over floor 0 and the passages that touch it."""
    height_m: float
    passages: list[dict[str, object]]


class Utc(TypeDecorator[datetime]):
    """A time in UTC, also where the database keeps no zone."""

    impl = sa.DateTime(timezone=True)
    cache_ok = True

    def process_result_value(self, value: datetime | None, dialect: sa.Dialect) -> datetime | None:
        """The time as it was stored."""
        if value is None or value.tzinfo is None:
            return value and value.replace(tzinfo=UTC)
        return value.astimezone(UTC)


class Base(DeclarativeBase):
    """Every table; times are UTC, ids are random and tell nothing."""

    type_annotation_map = {dict[str, Any]: sa.JSON, list[str]: sa.JSON, datetime: Utc}  # noqa: RUF012


def new_id() -> str:
    """An id that nobody can guess."""
    return uuid.uuid4().hex


def now_utc() -> datetime:
    """The time now."""
    return datetime.now(UTC)


def _part_of(column: str, **how: Any) -> MappedColumn[Any]:
    """What names a row of another table, with which this row goes."""
    return mapped_column(sa.ForeignKey(column, ondelete="CASCADE"), **how)


UserId = Annotated[str, _part_of("users.id", index=True)]
MapKey = Annotated[str, _part_of("maps.id", primary_key=True)]
UserKey = Annotated[str, _part_of("users.id", primary_key=True, index=True)]


class User(Base):
    """Someone with a pairing token, of which only the SHA-256 is kept."""

    __tablename__ = "users"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    name: Mapped[str]
    token_sha256: Mapped[str] = mapped_column(unique=True, index=True)
    is_owner: Mapped[bool] = mapped_column(default=False)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class Recording(Base):
    """A walk, by whoever uploaded it. `refusal` says why it cannot be read."""

    __tablename__ = "recordings"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    user_id: Mapped[UserId]
    name: Mapped[str]
    device: Mapped[str] = mapped_column(default="unknown")
    state: Mapped[str] = mapped_column(default=RecordingState.RECEIVING)
    refusal: Mapped[str | None] = mapped_column(default=None)
    facts: Mapped[RecordingFacts] = mapped_column(sa.JSON, default=dict)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class RecordingFile(Base):
    """One file of a recording's folder."""

    __tablename__ = "recording_files"
    recording_id: Mapped[str] = _part_of("recordings.id", primary_key=True)
    name: Mapped[str] = mapped_column(primary_key=True)
    sha256: Mapped[str] = mapped_column(index=True)
    size_bytes: Mapped[int] = mapped_column(sa.BigInteger)


class Upload(Base):
    """A file on its way. What has come lies on disk; its length is the offset.

    A whole recording as a .zip has no recording before its last byte came; then it is `finished`
    and its file is gone.
    """

    __tablename__ = "uploads"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    user_id: Mapped[UserId]
    recording_id: Mapped[str | None] = _part_of("recordings.id", index=True)
    file_name: Mapped[str]
    length_bytes: Mapped[int | None] = mapped_column(sa.BigInteger, default=None)
    wants_map: Mapped[bool] = mapped_column(default=True)
    finished: Mapped[bool] = mapped_column(default=False)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class Job(Base):
    """Work in the background: `given` is what it was asked, `gave` what came of it.

    `claim` is known to the one runner alone that works on it.
    """

    __tablename__ = "jobs"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    user_id: Mapped[UserId]
    kind: Mapped[str]
    state: Mapped[str] = mapped_column(default=JobState.QUEUED, index=True)
    given: Mapped[dict[str, Any]] = mapped_column(default=dict)
    gave: Mapped[dict[str, Any]] = mapped_column(default=dict)
    doing: Mapped[str] = mapped_column(default="")
    share: Mapped[float | None] = mapped_column(default=None)
    attempts: Mapped[int] = mapped_column(default=0)
    claim: Mapped[str | None] = mapped_column(default=None)
    problem: Mapped[str | None] = mapped_column(default=None)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)
    started_utc: Mapped[datetime | None] = mapped_column(default=None)
    finished_utc: Mapped[datetime | None] = mapped_column(default=None)


class JobFile(Base):
    """A file that a job made and that is part of no map."""

    __tablename__ = "job_files"
    job_id: Mapped[str] = _part_of("jobs.id", primary_key=True)
    name: Mapped[str] = mapped_column(primary_key=True)
    sha256: Mapped[str] = mapped_column(index=True)
    size_bytes: Mapped[int] = mapped_column(sa.BigInteger)


class Map(Base):
    """What a job made: the folder of a run, or of a floor map merged from runs.

    `sources` are the recordings that it came from, `floor_plan` the image below it. It may lie in a
    venue, and there on a floor, both by their names.
    """

    __tablename__ = "maps"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    user_id: Mapped[UserId]
    name: Mapped[str]
    kind: Mapped[str]
    sources: Mapped[list[str]] = mapped_column(default=list)
    facts: Mapped[MapFacts] = mapped_column(sa.JSON, default=dict)
    floor_plan: Mapped[dict[str, Any] | None] = mapped_column(default=None)
    venue: Mapped[str | None] = mapped_column(default=None)
    floor: Mapped[str | None] = mapped_column(default=None)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class MapFile(Base):
    """One file of a map's folder."""

    __tablename__ = "map_files"
    map_id: Mapped[MapKey]
    name: Mapped[str] = mapped_column(primary_key=True)
    sha256: Mapped[str] = mapped_column(index=True)
    size_bytes: Mapped[int] = mapped_column(sa.BigInteger)


class Store(Base):
    """Which data folder's files this database names, and which key its phones trust.

    One row. `id` is that of the folder, `signing_key` the key's fingerprint; `holder` and `beat`
    say who serves it (`opening.py`).
    """

    __tablename__ = "stores"
    id: Mapped[str] = mapped_column(primary_key=True)
    signing_key: Mapped[str | None] = mapped_column(default=None)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)
    holder: Mapped[dict[str, Any] | None] = mapped_column(sa.JSON(none_as_null=True), default=None)
    beat: Mapped[str | None] = mapped_column(default=None)


class MapPackage(Base):
    """What phones are told of a map, which `sources_sha256` says from what it was made.

    The revision grows with every change.
    """

    __tablename__ = "map_packages"
    map_id: Mapped[MapKey]
    sources_sha256: Mapped[str]
    revision: Mapped[int] = mapped_column(sa.BigInteger)
    manifest: Mapped[str]


class MapPart(Base):
    """A tile of a map's package."""

    __tablename__ = "map_parts"
    map_id: Mapped[MapKey]
    sha256: Mapped[str] = mapped_column(primary_key=True, index=True)
    size_bytes: Mapped[int] = mapped_column(sa.BigInteger)


Shared = Literal["read", "edit"]
"""What can be given to others."""


class MapShare(Base):
    """What somebody else may do to a map: `read` or `edit`."""

    __tablename__ = "map_shares"
    map_id: Mapped[MapKey]
    user_id: Mapped[UserKey]
    may: Mapped[Shared] = mapped_column(sa.String)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class UserGroup(Base):
    """Some people with whom somebody shares maps at once; its name is theirs alone."""

    __tablename__ = "user_groups"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    user_id: Mapped[UserId]
    name: Mapped[str]
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class GroupMember(Base):
    """Somebody in a group."""

    __tablename__ = "group_members"
    group_id: Mapped[str] = _part_of("user_groups.id", primary_key=True)
    user_id: Mapped[UserKey]


class MapGroupShare(Base):
    """What all in a group may do to a map, whoever is in it at that time."""

    __tablename__ = "map_group_shares"
    map_id: Mapped[MapKey]
    group_id: Mapped[str] = _part_of("user_groups.id", primary_key=True, index=True)
    may: Mapped[Shared] = mapped_column(sa.String)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class MapLink(Base):
    """What everyone may do to a map who has its link, the secret of which can be shown again."""

    __tablename__ = "map_links"
    map_id: Mapped[MapKey]
    secret: Mapped[str]
    may: Mapped[Shared] = mapped_column(sa.String)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


NUMBER = sa.BigInteger().with_variant(sa.Integer, "sqlite")
"""SQLite counts up whole numbers of this type alone."""


class KeptPosition(Base):
    """Where somebody was. `map_id` is that of a map, or of a published floor."""

    __tablename__ = "positions"
    __table_args__ = (sa.Index("positions_of_user", "user_id", "time_utc"),)
    number: Mapped[int] = mapped_column(NUMBER, primary_key=True, autoincrement=True)
    user_id: Mapped[str] = _part_of("users.id")
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
    map_id: Mapped[MapKey]
    is_on: Mapped[bool] = mapped_column(default=True)
    latitude_deg: Mapped[float | None] = mapped_column(default=None)
    longitude_deg: Mapped[float | None] = mapped_column(default=None)
    bearing_deg: Mapped[float | None] = mapped_column(default=None)


class Webhook(Base):
    """Where positions in a map are posted to. The secret signs them, so it is kept as it is."""

    __tablename__ = "webhooks"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    map_id: Mapped[str] = _part_of("maps.id", index=True)
    url: Mapped[str]
    secret: Mapped[str]
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


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
        sa.UniqueConstraint("building", "level"),
        sa.Index("floors_by_place", "latitude_deg", "longitude_deg"),
    )
    number: Mapped[int] = mapped_column(primary_key=True)
    id: Mapped[str] = mapped_column(unique=True, default=new_id)
    building: Mapped[int] = mapped_column(sa.ForeignKey("buildings.number"))
    level: Mapped[int]
    latitude_deg: Mapped[float]
    longitude_deg: Mapped[float]
    radius_m: Mapped[float]
    altitude_m: Mapped[float | None] = mapped_column(default=None)
    has_wifi: Mapped[bool]
    revision: Mapped[int] = mapped_column(sa.BigInteger)
    manifest: Mapped[str] = mapped_column(sa.Text)
    published_utc: Mapped[datetime] = mapped_column(default=now_utc)


class FloorPart(Base):
    """A file of a floor's package."""

    __tablename__ = "floor_parts"
    floor: Mapped[int] = _part_of("floors.number", primary_key=True)
    sha256: Mapped[str] = mapped_column(primary_key=True, index=True)
    size_bytes: Mapped[int] = mapped_column(sa.BigInteger)


class FloorPoint(Base):
    """An access point that is heard on a floor; found by its address, 48 bits."""

    __tablename__ = "floor_points"
    bssid: Mapped[int] = mapped_column(sa.BigInteger, primary_key=True, autoincrement=False)
    floor: Mapped[int] = _part_of("floors.number", primary_key=True, index=True)
    level_dbm: Mapped[float] = mapped_column(sa.REAL)
    spread_db: Mapped[float] = mapped_column(sa.REAL)
    share: Mapped[float] = mapped_column(sa.REAL)
