"""Floor 3: the stages put together. Read pipeline.py aloud and you know the method."""
