"""Live positions of walkers who consent: told to pages and other programs, kept for a set time."""
