"""Floor 3: the pipeline put together. Read pipeline.py aloud and you know the method."""
