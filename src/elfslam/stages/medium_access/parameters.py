"""How phones share the air, and how one hears that another chirps."""

from __future__ import annotations

from dataclasses import dataclass

from elfslam.base.parameters import parameter


@dataclass(frozen=True)
class MediumAccessParameters:
    """Rounds of slots, of which each phone keeps its share; a slot is a period of the chirp."""

    jitter_s: float = parameter(
        0.025,
        "s",
        "a chirp is played at a random moment of so much of its slot",
        low=0.0,
        high=0.03,
    )
    softer_db: float = parameter(
        4.0, "dB", "a chirp is by chance as loud as can be or so much softer", low=0.0, high=20.0
    )
    slots: int = parameter(8, "", "slots of a round, after which turns repeat", low=1, high=64)
    listen: int = parameter(8, "", "slots to listen before the first chirp", low=1, high=100)
    forget: int = parameter(
        100, "", "slots without another phone after which one is alone", low=1, high=10_000
    )
    check: float = parameter(
        0.3,
        "",
        "chance to keep silent in an own slot and listen, when it is new",
        low=0.0,
        high=1.0,
    )
    check_least: float = parameter(
        0.08, "", "the same for one in which nobody was heard time and again", low=0.0, high=1.0
    )
    check_alone: float = parameter(
        0.05, "", "the same for who heard nobody for long: that is how a newcomer is noticed",
        low=0.0, high=1.0,
    )  # fmt: skip
    free_after: int = parameter(
        2, "", "rounds without another phone after which a slot is free", low=1, high=20
    )
    claim: float = parameter(
        0.5,
        "",
        "chance to take a free slot for who has none; less for who has more",
        low=0.01,
        high=1.0,
    )
    keep: float = parameter(
        0.5,
        "",
        "of m slots one is given up with chance m / (m + keep) where it is disputed",
        low=0.1,
        high=100.0,
    )
    challenge: float = parameter(
        0.05, "", "chance of who has no slot to take one that is not free", low=0.0, high=1.0
    )
    stir: float = parameter(
        0.01,
        "",
        "chance to give up a slot for nothing, for who has all: it evens out the shares",
        low=0.0,
        high=1.0,
    )
    follow: float = parameter(
        0.05, "", "share of another phone's lead that the own slots follow", low=0.0, high=1.0
    )
    contrast: float = parameter(
        3.0, "", "another's chirp over the same moment of the frames around", low=1.0, high=1000.0
    )
    share: float = parameter(
        0.006, "", "another's chirp over the own direct sound, at the least", low=1e-4, high=1.0
    )
    frames: int = parameter(
        2, "", "frames before and behind that say what is usual", low=1, high=20
    )
