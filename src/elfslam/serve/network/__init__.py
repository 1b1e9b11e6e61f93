"""Where the server listens, and why browsers believe it."""
