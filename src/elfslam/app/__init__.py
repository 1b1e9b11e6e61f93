"""Floor 4: what a command or a job does, from files to files."""
