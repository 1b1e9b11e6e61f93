"""Maps are shared with groups of people."""

from alembic import op
from sqlalchemy import Column, DateTime, ForeignKeyConstraint, PrimaryKeyConstraint, String

revision, down_revision = "0005", "0004"
branch_labels = depends_on = None


def upgrade() -> None:
    """Nobody has a group yet."""
    op.create_table(
        "user_groups",
        Column("id", String(), nullable=False),
        Column("user_id", String(), nullable=False),
        Column("name", String(), nullable=False),
        Column("created_utc", DateTime(timezone=True), nullable=False),
        ForeignKeyConstraint(["user_id"], ["users.id"], ondelete="CASCADE"),
        PrimaryKeyConstraint("id"),
    )
    op.create_index("ix_user_groups_user_id", "user_groups", ["user_id"])
    op.create_table(
        "group_members",
        Column("group_id", String(), nullable=False),
        Column("user_id", String(), nullable=False),
        ForeignKeyConstraint(["group_id"], ["user_groups.id"], ondelete="CASCADE"),
        ForeignKeyConstraint(["user_id"], ["users.id"], ondelete="CASCADE"),
        PrimaryKeyConstraint("group_id", "user_id"),
    )
    op.create_index("ix_group_members_user_id", "group_members", ["user_id"])
    op.create_table(
        "map_group_shares",
        Column("map_id", String(), nullable=False),
        Column("group_id", String(), nullable=False),
        Column("may", String(), nullable=False),
        Column("created_utc", DateTime(timezone=True), nullable=False),
        ForeignKeyConstraint(["map_id"], ["maps.id"], ondelete="CASCADE"),
        ForeignKeyConstraint(["group_id"], ["user_groups.id"], ondelete="CASCADE"),
        PrimaryKeyConstraint("map_id", "group_id"),
    )
    op.create_index("ix_map_group_shares_group_id", "map_group_shares", ["group_id"])
