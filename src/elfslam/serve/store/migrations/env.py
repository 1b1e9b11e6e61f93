"""What Alembic runs: the migrations of a connection whose transaction is open already."""

from alembic import context

from elfslam.serve.store.schema import VERSION_TABLE
from elfslam.serve.store.tables import Base

connection = context.config.attributes["connection"]
context.configure(
    connection, target_metadata=Base.metadata, version_table=VERSION_TABLE, render_as_batch=True
)
with context.begin_transaction():
    context.run_migrations()
