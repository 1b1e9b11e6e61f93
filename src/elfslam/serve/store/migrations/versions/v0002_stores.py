"""A database knows the data folder whose files it names, and the key that its phones trust."""

from alembic import op
from sqlalchemy import Column, DateTime, String

revision, down_revision = "0002", "0001"
branch_labels = depends_on = None


def upgrade() -> None:
    """Adds the table of that one row; the row is written when the server starts."""
    op.create_table(
        "stores",
        Column("id", String, primary_key=True),
        Column("signing_key", String),
        Column("created_utc", DateTime(timezone=True), nullable=False),
    )
