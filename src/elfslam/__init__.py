"""Indoor positioning from the sound of a phone (ELF-SLAM and beyond)."""

__version__ = "0.1.0"
