"""Tables, figures and benchmarks: each file makes one. `python -m studies NAME OUT` runs it."""
