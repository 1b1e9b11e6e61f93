"""Slotted medium access: which phone chirps when, and how others are heard."""

from elfslam.stages.medium_access.foreign import spoiled_frames
from elfslam.stages.medium_access.listening import CarrierSense, Slot, hear_slot
from elfslam.stages.medium_access.parameters import MediumAccessParameters
from elfslam.stages.medium_access.slots import SlotSchedule, after_slot, initial_schedule, is_played

__all__ = [
    "CarrierSense",
    "MediumAccessParameters",
    "Slot",
    "SlotSchedule",
    "after_slot",
    "hear_slot",
    "initial_schedule",
    "is_played",
    "spoiled_frames",
]
