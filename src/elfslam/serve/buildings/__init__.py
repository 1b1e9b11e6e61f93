"""Maps of many buildings, and which of them a phone is in that does not know where it is."""
