"""Floor 4: one file per table or figure, each run by one command."""
