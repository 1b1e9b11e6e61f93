"""Floor 3: networks, losses, training and export. The only room that imports torch."""
