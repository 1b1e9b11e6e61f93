"""Floor 5: the web server, its pages, and the index of features."""
