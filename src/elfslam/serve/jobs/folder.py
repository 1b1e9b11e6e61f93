"""The folder of a job: what its process finds there, and what it leaves."""

TASK, GIVEN, OUT = "task.json", "given", "out"
FIXES = "fixes.csv"
DISK_FULL = "the server's disk is full; free some space there, then retry"
"""What a process says that could not write."""
