"""Floor 3: rivals on the same line: other sensors and other features."""
