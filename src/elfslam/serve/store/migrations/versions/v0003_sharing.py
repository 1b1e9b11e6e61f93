"""Maps lie on floors of venues, and are shared with people and by link."""

from alembic import op
from sqlalchemy import Column, DateTime, ForeignKey, String

revision, down_revision = "0003", "0002"
branch_labels = depends_on = None


def upgrade() -> None:
    """Maps of before lie nowhere and are shared with nobody."""
    user, time = ForeignKey("users.id", ondelete="CASCADE"), DateTime(timezone=True)
    op.add_column("maps", Column("venue", String))
    op.add_column("maps", Column("floor", String))
    op.create_table(
        "map_shares",
        Column("map_id", String, ForeignKey("maps.id", ondelete="CASCADE"), primary_key=True),
        Column("user_id", String, user, primary_key=True, index=True),
        Column("may", String, nullable=False),
        Column("created_utc", time, nullable=False),
    )
    op.create_table(
        "map_links",
        Column("map_id", String, ForeignKey("maps.id", ondelete="CASCADE"), primary_key=True),
        Column("secret", String, nullable=False),
        Column("may", String, nullable=False),
        Column("created_utc", time, nullable=False),
    )
