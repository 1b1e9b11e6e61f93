"""What the server remembers: rows, files, and how they go."""
