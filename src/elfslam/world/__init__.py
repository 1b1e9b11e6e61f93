"""Floor 3: the simulator of rooms, sound, phones and walkers."""
