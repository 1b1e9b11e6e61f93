"""Floor 3: recordings, runs and maps on disk, and importers of other formats."""
