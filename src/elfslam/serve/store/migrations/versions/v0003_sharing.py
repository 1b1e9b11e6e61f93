"""Maps lie on floors of venues, and are shared with people and by link."""

from alembic import op
from sqlalchemy import Column, DateTime, ForeignKeyConstraint, PrimaryKeyConstraint, String

revision, down_revision = "0003", "0002"
branch_labels = depends_on = None


def upgrade() -> None:
    """Maps of before lie nowhere and are shared with nobody."""
    op.add_column("maps", Column("venue", String()))
    op.add_column("maps", Column("floor", String()))
    op.create_table(
        "map_shares",
        Column("map_id", String(), nullable=False),
        Column("user_id", String(), nullable=False),
        Column("may", String(), nullable=False),
        Column("created_utc", DateTime(timezone=True), nullable=False),
        ForeignKeyConstraint(["map_id"], ["maps.id"], ondelete="CASCADE"),
        ForeignKeyConstraint(["user_id"], ["users.id"], ondelete="CASCADE"),
        PrimaryKeyConstraint("map_id", "user_id"),
    )
    op.create_index("ix_map_shares_user_id", "map_shares", ["user_id"])
    op.create_table(
        "map_links",
        Column("map_id", String(), nullable=False),
        Column("secret", String(), nullable=False),
        Column("may", String(), nullable=False),
        Column("created_utc", DateTime(timezone=True), nullable=False),
        ForeignKeyConstraint(["map_id"], ["maps.id"], ondelete="CASCADE"),
        PrimaryKeyConstraint("map_id"),
    )
