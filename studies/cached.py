"""Simulated walks, their echoes and features, made once and shared by all studies.

They are kept by what they were made of, with a digest of the code that made them, in the folder
`ELFSLAM_CACHE` (the user's cache where it is not named; nothing is kept where it is empty).
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from elfslam.app.settings import Settings
from elfslam.base.values import Echoes, Features, Recording, Truth
from elfslam.slam import front_end
from elfslam.stages.feature import Encoder
from elfslam.stages.feature import extract_features as extract
from elfslam.world import simulate as simulator
from studies.results import ROOT, code_of

Made = TypeVar("Made")
MOST_BYTES = 24 * 2**30


def simulate(world: simulator.World, seed: int, **how: Any) -> tuple[Recording, Truth]:
    """As `elfslam.world.simulate.simulate`, which says what `how` may be."""
    return _kept(_simulate, world, seed, how, _digest(simulator.__name__))


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


@cache
def _digest(module: str) -> str:
    """Of the code that a module runs."""
    files = sorted(code_of(module))
    return hashlib.sha256(b"".join((ROOT / file).read_bytes() for file in files)).hexdigest()
