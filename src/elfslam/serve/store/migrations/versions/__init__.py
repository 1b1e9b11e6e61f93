"""The versions of the schema; each names the one before it."""
