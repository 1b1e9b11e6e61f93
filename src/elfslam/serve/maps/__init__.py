"""Maps: looked at, laid on floor plans, taken home."""
