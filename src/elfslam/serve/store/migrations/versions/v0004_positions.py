"""Positions of walkers who consent, what a map says of them, and webhooks that get them."""

from alembic import op
from sqlalchemy import BigInteger, Boolean, Column, DateTime, Double, ForeignKey, Integer, String

revision, down_revision = "0004", "0003"
branch_labels = depends_on = None

NUMBER = BigInteger().with_variant(Integer, "sqlite")
TIME = DateTime(timezone=True)
PLACE = ("x_m", "y_m", "heading_rad", "sigma_m", "latitude_deg", "longitude_deg")


def upgrade() -> None:
    """Adds three tables, all of them empty."""
    op.create_table(
        "positions",
        Column("number", NUMBER, primary_key=True, autoincrement=True),
        Column("user_id", String, ForeignKey("users.id", ondelete="CASCADE"), nullable=False),
        Column("map_id", String, nullable=False, index=True),
        Column("walk", String, nullable=False),
        Column("time_utc", TIME, nullable=False, index=True),
        Column("status", String, nullable=False),
        *(Column(name, Double) for name in PLACE),
    )
    op.create_index("positions_of_user", "positions", ["user_id", "time_utc"])
    op.create_table(
        "map_positions",
        Column("map_id", String, ForeignKey("maps.id", ondelete="CASCADE"), primary_key=True),
        Column("is_on", Boolean, nullable=False),
        *(Column(name, Double) for name in ("latitude_deg", "longitude_deg", "bearing_deg")),
    )
    op.create_table(
        "webhooks",
        Column("id", String, primary_key=True),
        Column(
            "map_id", String, ForeignKey("maps.id", ondelete="CASCADE"), nullable=False, index=True
        ),
        Column("url", String, nullable=False),
        Column("secret", String, nullable=False),
        Column("created_utc", TIME, nullable=False),
    )
