"""From bytes that come to a recording that can be read."""
