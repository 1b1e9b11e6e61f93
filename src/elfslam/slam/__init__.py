"""Floor 3: the line put together. Read pipeline.py aloud and you know the method."""
