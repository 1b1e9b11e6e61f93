"""Codes that pair: good once, for a while, and not without bound."""

from __future__ import annotations

from elfslam.serve.services import MOST, OneTimeCodes


class Clock:
    """A time that is told."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_a_code_gives_its_token_once() -> None:
    codes = OneTimeCodes()
    mine, theirs = codes.make("mine"), codes.make("theirs")
    assert codes.redeem(theirs) == "theirs"
    assert codes.redeem(mine) == "mine"
    assert codes.redeem(mine) is None
    assert codes.redeem("never made") is None


def test_a_code_ends() -> None:
    clock = Clock()
    codes = OneTimeCodes(lasts_s=600.0, clock=clock)
    early = codes.make("early")
    clock.now_s = 599.0
    late = codes.make("late")
    clock.now_s = 600.0
    assert codes.redeem(early) is None
    assert codes.redeem(late) == "late"


def test_the_oldest_codes_give_way() -> None:
    codes = OneTimeCodes()
    made = [codes.make(str(number)) for number in range(MOST + 1)]
    assert len(set(made)) == MOST + 1
    assert codes.redeem(made[0]) is None
    assert [codes.redeem(made[1]), codes.redeem(made[-1])] == ["1", str(MOST)]
