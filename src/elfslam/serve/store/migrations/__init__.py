"""Schema migrations of the server's database (Alembic): one file a version, oldest first."""
