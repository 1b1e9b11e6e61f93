"""Floor 1: the method, one stage a file; no stage imports another."""
