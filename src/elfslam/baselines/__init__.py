"""Floor 3: other modalities and other features through the same stages."""
