"""Floor 3: other sensors and other features through the same stages."""
