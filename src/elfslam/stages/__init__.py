"""Floor 2: the method, one stage a file or folder; no stage imports another."""
