"""Slotted medium access: slots in rounds, kept while free, given up on a collision.

Listening right before a chirp tells little, as a phone hears 12 to 500 ms late. But turns repeat
from round to round, so what was heard in a slot some rounds ago tells who will chirp in it. A phone
alone has all slots. It keeps silent in one now and then and listens, more often once others were
heard: two that chirp at once mostly hear themselves first. Where two are heard in one slot each
may give it up, sooner who has more of them; where nobody is heard for some rounds each may take it,
sooner who has fewer. That is reservation ALOHA (Crowther et al., 1973) with chances that even out
the shares. Slots have no common clock: each phone moves its own towards the others' it hears.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from elfslam.stages.medium_access.parameters import MediumAccessParameters

Value = TypeVar("Value")


@dataclass(frozen=True)
class SlotSchedule:
    """Whose turn it is, by slot of the round, and what it was learnt from.

    `mine`: whether the slot is ours; `quiet`: rounds since another phone was heard in it; `sure`:
    how often we kept silent in it, as it is ours, and heard nobody. `alone` counts slots since
    another was heard at all; `shift_s` is how far the own slots have moved.
    """

    mine: tuple[bool, ...]
    quiet: tuple[int, ...]
    sure: tuple[int, ...]
    alone: int
    shift_s: float = 0.0


def initial_schedule(parameters: MediumAccessParameters) -> SlotSchedule:
    """Where everybody begins: listening."""
    nothing = (0,) * parameters.slots
    return SlotSchedule(
        (False,) * parameters.slots, nothing, nothing, parameters.forget - parameters.listen
    )


def is_played(
    schedule: SlotSchedule, slot: int, draw: float, parameters: MediumAccessParameters
) -> bool:
    """Whether to chirp in a slot, counted from the beginning; `draw` is uniform in [0, 1)."""
    if schedule.alone >= parameters.forget:
        return draw >= parameters.check_alone
    k = slot % parameters.slots
    silent = max(parameters.check / (1 + schedule.sure[k]), parameters.check_least)
    return schedule.mine[k] and draw >= silent


def after_slot(
    schedule: SlotSchedule,
    slot: int,
    others_s: Sequence[float],
    draw: float,
    parameters: MediumAccessParameters,
    *,
    played: bool,
) -> SlotSchedule:
    """What is known once a slot has been heard.

    `others_s` are the moments of other phones' chirps in it, counted from the middle of where the
    own would be played; `played` whether there was an own one. `draw` is uniform in [0, 1).
    """
    k, met = slot % parameters.slots, len(others_s) > 0
    now = replace(
        schedule,
        quiet=_with(schedule.quiet, k, 0 if met else schedule.quiet[k] + 1),
        alone=0 if met else schedule.alone + 1,
        shift_s=schedule.shift_s + parameters.follow * float(np.sum(others_s)),
    )
    if now.alone >= parameters.forget:
        every = (True,) * parameters.slots
        return replace(now, mine=every, sure=(0,) * parameters.slots)
    kept = _is_kept(now, k, draw, parameters)
    checked = schedule.mine[k] and kept and not met and not played
    sure = schedule.sure[k] + 1 if checked else schedule.sure[k] * int(kept and not met)
    return replace(now, mine=_with(now.mine, k, kept), sure=_with(now.sure, k, sure))


def _is_kept(
    schedule: SlotSchedule, k: int, draw: float, parameters: MediumAccessParameters
) -> bool:
    """Whether a slot that was just heard is ours from now on."""
    own = sum(schedule.mine)
    if schedule.mine[k]:
        if schedule.quiet[k] == 0:
            return draw >= own / (own + parameters.keep)
        return draw >= parameters.stir * own / parameters.slots
    if schedule.quiet[k] >= parameters.free_after:
        return draw < parameters.claim / (1 + own)
    return own == 0 and draw < parameters.challenge


def _with(values: tuple[Value, ...], k: int, value: Value) -> tuple[Value, ...]:
    return (*values[:k], value, *values[k + 1 :])
