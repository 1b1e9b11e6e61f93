"""Simulated walks, their echoes and features, made once and shared by all studies.

They are kept by what they were made of, with a digest of the code that made them, in the folder
`ELFSLAM_CACHE` (the user's cache where it is not named; nothing is kept where it is empty).
"""

import os
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Protocol, TypeVar

from elfslam.app.settings import Settings
from elfslam.base.values import Echoes, Features, Recording, Truth
from elfslam.slam import front_end
from elfslam.stages.feature import Encoder, load_encoder
from elfslam.stages.feature import extract_features as extract
from elfslam.world import simulate as simulator
from elfslam.world import simulate_building as building_simulator
from elfslam.world.building import MultiFloorWorld
from elfslam.world.kinds import QUIET, Kind, kind_named
from elfslam.world.sensors import Sensor
from studies.reached import digest as _digest
from studies.results import Record

Made = TypeVar("Made")
MOST_BYTES = 24 * 2**30
SCENARIOS: Mapping[str, str] = {
    "people": "pedestrian", "surveyor": "surveyor", "quiet": "controlled",
}  # fmt: skip
"""By kind of simulated walk what results call it: who walks how, and in what circumstances."""


@dataclass(frozen=True)
class SimulatedWalk:
    """A walk of a kind, for so many rounds."""

    world: str
    seed: int
    rounds: int
    kind: str = QUIET.name


class InWorld(Protocol):
    """What is measured in a world by walks of a kind, both by name."""

    @property
    def world(self) -> str:
        """As `load_world` knows it."""

    @property
    def kind(self) -> str:
        """As `kind_named` knows it."""


def record_of(task: InWorld, method: str, condition: str = "") -> Record:
    """Where and of what walks something is measured."""
    return Record(method, world=task.world, scenario=SCENARIOS[task.kind], condition=condition)


def simulated(walk: SimulatedWalk, *, sensors: Collection[Sensor] = ()) -> tuple[Recording, Truth]:
    """The recording of a walk on a day of mapping, and where it went."""
    kind = kind_named(walk.kind)
    return simulated_in(
        simulator.load_world(walk.world), walk.seed, walk.rounds, kind, sensors=sensors
    )


@cache
def shipped() -> Encoder:
    """The encoder that comes with the package."""
    return load_encoder("compact")


def at_its_start(recording: Recording, truth: Truth) -> Recording:
    """The recording of someone who said where the walk begins."""
    x_m, y_m, heading_rad = truth.world_from_body[0].tolist()
    return replace(recording, start_pose=(x_m, y_m, heading_rad))


def simulated_in(
    world: simulator.World,
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


def simulate(world: simulator.World, seed: int, **how: Any) -> tuple[Recording, Truth]:
    """As `elfslam.world.simulate.simulate`, which says what `how` may be."""
    return _kept(_simulate, world, seed, how, _digest(simulator.__name__))


def simulate_building(building: MultiFloorWorld, seed: int, **how: Any) -> tuple[Recording, Truth]:
    """As `elfslam.world.simulate_building.simulate_building`."""
    return _kept(_walk_floors, building, seed, how, _digest(building_simulator.__name__))


def extract_echoes(recording: Recording, settings: Settings) -> Echoes:
    """As `elfslam.slam.front_end.extract_echoes`."""
    return _kept(_hear, recording, settings, _digest(front_end.__name__))


def extract_features(echoes: Echoes, encoder: Encoder) -> Features:
    """As `elfslam.stages.feature.extract_features`, by the encoder's identity."""
    memory = _memory()
    if memory is None:
        return extract(echoes, encoder)
    kept = memory.cache(_extract, ignore=["encoder"], verbose=0)
    found: Features = kept(echoes, encoder, encoder.identity, _digest("elfslam.stages.feature"))
    return found


def bound_cache() -> None:
    """Forget what nobody asked for in a long time, until the cache is within its bound."""
    memory = _memory()
    if memory is not None:
        memory.reduce_size(bytes_limit=MOST_BYTES)


def _simulate(
    world: simulator.World, seed: int, how: dict[str, Any], code: str
) -> tuple[Recording, Truth]:
    return simulator.simulate(world, seed, **how)


def _walk_floors(
    building: MultiFloorWorld, seed: int, how: dict[str, Any], code: str
) -> tuple[Recording, Truth]:
    return building_simulator.simulate_building(building, seed, **how)


def _hear(recording: Recording, settings: Settings, code: str) -> Echoes:
    return front_end.extract_echoes(recording, settings)


def _extract(echoes: Echoes, encoder: Encoder, identity: str, code: str) -> Features:
    return extract(echoes, encoder)


def _kept(make: Callable[..., Made], *given: Any) -> Made:
    memory = _memory()
    if memory is None:
        return make(*given)
    made: Made = memory.cache(make, verbose=0)(*given)
    return made


@cache
def _memory() -> Any:
    from joblib import Memory

    usual = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "elfslam"
    folder = os.environ.get("ELFSLAM_CACHE", str(usual))
    return Memory(folder, verbose=0) if folder else None
