"""Files from outside are parsed in child processes: bounded, in turn, away from what answers."""
