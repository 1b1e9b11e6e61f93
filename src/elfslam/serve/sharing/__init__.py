"""Who else may use a map: people of this server, and everyone who has its link."""
