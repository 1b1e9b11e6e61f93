"""A simulated walk as studies ask for it: in a world, by a seed, of a kind."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from elfslam.base.values import Recording, Truth
from elfslam.world.kinds import QUIET, Kind, kind_named
from elfslam.world.sensors import Sensor
from elfslam.world.simulate import World, load_world
from studies.cached import simulate


@dataclass(frozen=True)
class SimulatedWalk:
    """A walk of a kind, for so many rounds."""

    world: str
    seed: int
    rounds: int
    kind: str = QUIET.name


def simulated(walk: SimulatedWalk, *, sensors: Collection[Sensor] = ()) -> tuple[Recording, Truth]:
    """The recording of a walk on a day of mapping, and where it went."""
    kind = kind_named(walk.kind)
    return simulated_in(load_world(walk.world), walk.seed, walk.rounds, kind, sensors=sensors)


def simulated_in(
    world: World,
    seed: int,
    rounds: int,
    kind: Kind,
    *,
    sensors: Collection[Sensor] = (),
    reverse: bool = False,
) -> tuple[Recording, Truth]:
    """The same in a world that was read, or the opposite way round."""
    return simulate(
        world, seed, rounds=rounds, sensors=sensors, walker=kind.walker,
        circumstances=kind.mapping(world.room), reverse=reverse,
    )  # fmt: skip
