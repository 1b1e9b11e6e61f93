"""Floor 3: baselines through the same pipeline: other modalities and other features."""
