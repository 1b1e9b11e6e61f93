"""A simulated walk as the line hears it, and how much longer its steps truly are."""

from __future__ import annotations

from dataclasses import dataclass

from elfslam.base.geometry import path_length_m
from elfslam.base.values import Chirp, Echoes, Odometry, Truth
from elfslam.line.chirp import make_chirp
from elfslam.scoring.alignment import match
from elfslam.slam.front_end import hear, walk_nodes
from elfslam.slam.parameters import Parameters
from studies.simulated_walk import SimulatedWalk, simulated


@dataclass(frozen=True, eq=False)
class Heard:
    """What the line has of a walk, and the truth."""

    nodes: Odometry
    echoes: Echoes
    chirp: Chirp
    truth: Truth


def hear_walk(walk: SimulatedWalk) -> Heard:
    """A walk as the line hears it."""
    recording, truth = simulated(walk)
    assert recording.audio is not None
    parameters = Parameters()
    chirp = make_chirp(parameters.chirp, recording.audio.rate_hz)
    nodes = walk_nodes(recording, parameters)
    return Heard(nodes, hear(recording, parameters), chirp, truth)


def true_scale(nodes: Odometry, truth: Truth) -> float:
    """True over claimed length of a walk, both from footstep to footstep."""
    matched = match(nodes.t_s, nodes.world_from_body, truth)
    return path_length_m(matched.truth[:, :2]) / path_length_m(matched.estimate[:, :2])
