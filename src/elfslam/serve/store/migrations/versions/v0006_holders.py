"""A database knows which data folder holds it, and whether that is being served."""

from alembic import op
from sqlalchemy import JSON, Column, String

revision, down_revision = "0006", "0005"
branch_labels = depends_on = None


def upgrade() -> None:
    """Nobody holds it before the server starts."""
    op.add_column("stores", Column("holder", JSON()))
    op.add_column("stores", Column("beat", String()))
