"""What a recording gives the line: footsteps, echoes, features, and how long the steps are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elfslam.base.arrays import Bool
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_RATE_HZ, Echoes, Odometry, Recording
from elfslam.line.acoustic_odometry import measure_scale, rescaled, with_prior
from elfslam.line.chirp import make_chirp
from elfslam.line.echo import Frames, echoes_of, find_frames, frame_facts
from elfslam.line.medium_access import spoiled_frames
from elfslam.line.motion import dead_reckon, nodes_by_distance
from elfslam.line.spoofing import Suspicion, nothing_suspect, suspicion
from elfslam.slam.parameters import Parameters


def walk_nodes(recording: Recording, parameters: Parameters) -> Odometry:
    """Footsteps where there is an IMU, else places along the device's own odometry."""
    if recording.imu is not None:
        return dead_reckon(recording.imu, parameters.motion, recording.start_pose)
    if recording.odometry is not None:
        return nodes_by_distance(recording.odometry, parameters.motion.node_spacing_m)
    raise InputError(
        f"{recording.name}: it has neither motion sensors nor odometry; "
        "record accelerometer and gyroscope"
    )


def hear(recording: Recording, parameters: Parameters) -> Echoes:
    """The echoes of a recording's sound.

    Where it says when its chirps were played, frames that other phones chirped into are left out.
    """
    frames = _frames(recording, parameters)
    return echoes_of(frames, parameters.echo, _duration_s(recording), _spoiled(frames, parameters))


def hear_for_fixes(recording: Recording, parameters: Parameters) -> tuple[Echoes, Suspicion]:
    """The echoes of a recording, and which stretches of it are suspect.

    Where it says when it chirped, frames that are lacking, clipped or spoiled are judged one by
    one; else many of them are refused, and nothing is suspect.
    """
    if recording.played_t_s is None:
        return hear(recording, parameters), nothing_suspect
    lenient = replace(parameters.echo, found_share=0.0, clipped_share=1.0)
    frames = _frames(recording, replace(parameters, echo=lenient))
    duration_s, spoiled = _duration_s(recording), _spoiled(frames, parameters)
    facts = frame_facts(frames, lenient, duration_s, recording.gain_db)
    every = clean = echoes_of(frames, lenient, duration_s)
    if spoiled is not None and len(spoiled) >= 2:
        ends = np.isin(np.arange(len(spoiled)), [0, len(spoiled) - 1])  # they say how long it is
        clean = echoes_of(frames, lenient, duration_s, spoiled & ~ends)
    return clean, suspicion(facts, every, parameters.spoofing, clean)


def with_heard_steps(nodes: Odometry, echoes: Echoes, parameters: Parameters) -> Odometry:
    """The walk with its steps as long as the echoes say, weighed against what is known of them.

    As it was where nothing about the steps is uncertain, or the sound cannot tell.
    """
    if not nodes.scale_sigma:
        return nodes
    chirp = make_chirp(parameters.chirp, ECHO_RATE_HZ)
    heard = measure_scale(echoes, nodes, chirp, parameters.acoustic_odometry)
    return rescaled(nodes, with_prior(heard, nodes.scale_sigma))


def _frames(recording: Recording, parameters: Parameters) -> Frames:
    if recording.audio is None:
        raise InputError(
            f"{recording.name}: it has no sound; "
            "map it with --by magnetic, or record while chirping"
        )
    chirp = make_chirp(parameters.chirp, recording.audio.rate_hz)
    return find_frames(recording.audio, chirp, parameters.echo, recording.played_t_s)


def _spoiled(frames: Frames, parameters: Parameters) -> Bool | None:
    if not frames.scheduled:
        return None
    return spoiled_frames(frames.envelope, frames.arrivals.samples, parameters.medium_access)


def _duration_s(recording: Recording) -> float | None:
    """How long the motion sensors ran."""
    motion = recording.imu or recording.odometry
    return None if motion is None else float(motion.t_s[-1])
