"""What things cost and survive: `python -m studies.benchmarks.NAME` runs one."""
