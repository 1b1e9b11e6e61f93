"""Maps are shared with groups of people."""

from alembic import op
from sqlalchemy import Column, DateTime, ForeignKey, String

revision, down_revision = "0005", "0004"
branch_labels = depends_on = None


def part_of(table: str) -> ForeignKey:
    """A row of another table, with which the row that names it goes."""
    return ForeignKey(f"{table}.id", ondelete="CASCADE")


def upgrade() -> None:
    """Nobody has a group yet."""
    op.create_table(
        "user_groups",
        Column("id", String, primary_key=True),
        Column("user_id", String, part_of("users"), nullable=False, index=True),
        Column("name", String, nullable=False),
        Column("created_utc", DateTime(timezone=True), nullable=False),
    )
    op.create_table(
        "group_members",
        Column("group_id", String, part_of("user_groups"), primary_key=True),
        Column("user_id", String, part_of("users"), primary_key=True, index=True),
    )
    op.create_table(
        "map_group_shares",
        Column("map_id", String, part_of("maps"), primary_key=True),
        Column("group_id", String, part_of("user_groups"), primary_key=True, index=True),
        Column("may", String, nullable=False),
        Column("created_utc", DateTime(timezone=True), nullable=False),
    )
