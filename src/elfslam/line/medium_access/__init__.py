"""Slotted medium access: which phone chirps when, and how others are heard."""

from elfslam.line.medium_access.foreign import spoiled_frames
from elfslam.line.medium_access.listening import CarrierSense, Slot, hear_slot
from elfslam.line.medium_access.parameters import TurnsParameters
from elfslam.line.medium_access.slots import Turns, after_slot, is_played, no_turns

__all__ = [
    "CarrierSense",
    "Slot",
    "Turns",
    "TurnsParameters",
    "after_slot",
    "hear_slot",
    "is_played",
    "no_turns",
    "spoiled_frames",
]
