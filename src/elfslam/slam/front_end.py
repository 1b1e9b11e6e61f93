"""What a recording gives the pipeline: footsteps, echoes, features, and how long the steps are."""

from dataclasses import replace

import numpy as np

from elfslam.base.arrays import F64, Bool
from elfslam.base.building import FloorsVisited
from elfslam.base.errors import InputError
from elfslam.base.geometry import between, compose
from elfslam.base.values import ECHO_RATE_HZ, Echoes, Odometry, Recording
from elfslam.slam.coverage import duration_s, motion_times_s, stretches, within
from elfslam.slam.parameters import Parameters
from elfslam.stages.acoustic_odometry import measure_scale, rescaled, with_prior
from elfslam.stages.chirp import make_chirp
from elfslam.stages.echo import Frames, echoes_of, find_frames, frame_facts
from elfslam.stages.levels import find_levels, levels_by_taps, numbered_by_taps
from elfslam.stages.medium_access import spoiled_frames
from elfslam.stages.motion import (
    Compass,
    compass_heading,
    dead_reckon,
    half_turned,
    missed_half_turn,
    nodes_by_distance,
)
from elfslam.stages.spoofing import Suspicion, nothing_suspect, suspicion


def dead_reckoned(recording: Recording, parameters: Parameters) -> tuple[Odometry, Compass | None]:
    """Footsteps where there is an IMU, else places along the device's own odometry.

    Where no heading at the start is declared (see `compass_of`), that of the compass is taken,
    which comes with them.
    """
    if recording.imu is not None:
        x_m, y_m, heading_rad = recording.start_pose or (0.0, 0.0, np.nan)
        declared = (x_m, y_m, float(np.nan_to_num(heading_rad)))
        nodes = dead_reckon(recording.imu, parameters.motion, declared)
        compass = compass_of(recording, parameters)
        if compass is not None:
            nodes = by_compass(nodes, declared, compass, parameters)
        return nodes, compass
    if recording.odometry is not None:
        return nodes_by_distance(recording.odometry, parameters.motion.node_spacing_m), None
    raise InputError(
        f"{recording.name}: it has neither motion sensors nor odometry; "
        "record accelerometer and gyroscope"
    )


def dead_reckoning_nodes(recording: Recording, parameters: Parameters) -> Odometry:
    """The nodes of a walk as dead reckoning has them."""
    return dead_reckoned(recording, parameters)[0]


FEWEST_ON_FLOOR = 8
"""A floor on which somebody took fewer footsteps was passed, not walked."""


def floors_visited(
    recording: Recording, nodes: Odometry, parameters: Parameters
) -> FloorsVisited | None:
    """The floors of a walk, by its barometer or as it named them; None where it stayed on one."""
    known = parameters.levels
    if recording.barometer is not None:
        found = find_levels(recording.barometer, nodes.t_s, known)
        named: FloorsVisited | None = numbered_by_taps(found, recording.checkpoints)
    else:
        named = levels_by_taps(recording.checkpoints, float(nodes.t_s[0]), known)
    several = named is not None and len(floors_walked(named, nodes.t_s)) > 1
    return named if several else None


def floors_walked(visited: FloorsVisited, footsteps_t_s: F64) -> list[int]:
    """The levels on which somebody took so many footsteps that there is something to map."""
    level = visited.levels.at(footsteps_t_s)
    steps = {each.level: int((level == each.level).sum()) for each in visited.floors}
    return [floor for floor, count in steps.items() if count >= FEWEST_ON_FLOOR]


def compass_of(recording: Recording, parameters: Parameters) -> Compass | None:
    """The compass that a walk is headed by: none where its heading at the start is declared.

    None, too, where nothing of the start is declared and there is no field to go by. Raises
    InputError where a position is declared, and nobody says which way the walk went from there.
    """
    imu, field, start = recording.imu, recording.magnetometer, recording.start_pose
    if imu is None or (start is not None and np.isfinite(start[2])):
        return None
    try:
        if field is None:
            raise InputError("compass: the recording has no magnetometer")
        return compass_heading(imu, field, parameters.motion)
    except InputError as why:
        if start is None:
            return None
        raise InputError(f"{recording.name}: the start has no heading ({why}); give one") from why


def with_missed_half_turn(recording: Recording, parameters: Parameters) -> Recording:
    """The recording with the half turn that its gyroscope missed, and a note of it, if one is told.

    A magnetometer tells it (`missed_half_turn`). Motion that cannot be levelled stays as it is.
    """
    imu, field = recording.imu, recording.magnetometer
    if imu is None or field is None:
        return recording
    try:
        at_s = missed_half_turn(imu, field, parameters.motion)
    except InputError:
        return recording
    if at_s is None:
        return recording
    note = (
        f"the gyroscope missed a half turn after {at_s - imu.t_s[0]:.0f} s, as the magnetometer "
        "tells; the walk is turned there"
    )
    return replace(recording, imu=half_turned(imu, at_s), notes=(*recording.notes, note))


def by_compass(
    nodes: Odometry, start: tuple[float, float, float], compass: Compass, parameters: Parameters
) -> Odometry:
    """The walk turned about its start, so that its first footstep heads as the compass says."""
    ahead_rad = compass.heading_rad - np.pi / 2 + parameters.motion.magnetic_north_rad
    turn_rad = ahead_rad - nodes.world_from_body[0, 2]
    poses = compose(
        np.array([*start[:2], turn_rad]),
        between(np.array([*start[:2], 0.0]), nodes.world_from_body),
    )
    sigma = nodes.step_sigma.copy()
    sigma[0, 2] = np.hypot(sigma[0, 2], compass.sigma_rad)
    return replace(nodes, world_from_body=poses, step_sigma=sigma)


def extract_echoes(recording: Recording, parameters: Parameters) -> Echoes:
    """The echoes of a recording's sound, as far as it has motion: no other can be placed.

    Where it says when its chirps were played, frames that other phones chirped into are left out.
    """
    frames = _frames(recording, parameters)
    ran_s, spoiled = duration_s(recording), _spoiled(frames, parameters)
    return placeable(recording, echoes_of(frames, parameters.echo, ran_s, spoiled), parameters)


LEAST_OVER_NOISE_DB = -3.0
"""Below, few phones close any loop, whatever their mean features are corrected by
(`stages/feature.py: attenuation_of`)."""


def too_noisy(echoes: Echoes) -> str | None:
    """In plain words, that places will not be known again by echoes that lie so near the noise."""
    over_db = echoes.over_noise_db
    if not over_db < LEAST_OVER_NOISE_DB:
        return None
    return (
        f"echoes lie {-over_db:.0f} dB under the noise of a chirp, wanted at most "
        f"{-LEAST_OVER_NOISE_DB:g} dB under it: few places or none will be known again; uncover "
        "the microphone and turn the volume up, or record by another microphone or phone"
    )


def placeable(recording: Recording, echoes: Echoes, parameters: Parameters) -> Echoes:
    """The echoes that were heard while motion was measured, in the stretch that was chosen.

    Raises InputError where there are none.
    """
    t_s, gap_s = motion_times_s(recording), parameters.motion.longest_gap_s
    inside = np.ones(len(echoes.t_s), dtype=bool)
    if t_s is not None and recording.imu is not None:
        spans = stretches(t_s, gap_s)
        spans[[0, -1], [0, 1]] += [-gap_s, gap_s]
        inside = within(echoes.t_s, spans)
    if recording.crop_s is not None:
        inside &= within(echoes.t_s, np.array([recording.crop_s]))
    if not inside.any():
        raise InputError(
            f"{recording.name}: its sound and its motion do not meet in time; record again, or "
            "choose another stretch"
        )
    return echoes.chosen(inside)


def extract_query_echoes(recording: Recording, parameters: Parameters) -> tuple[Echoes, Suspicion]:
    """The echoes of a recording, and which stretches of it are suspect.

    Where it says when it chirped, frames that are lacking, clipped or spoiled are judged one by
    one; else many of them are refused, and nothing is suspect.
    """
    if recording.played_t_s is None:
        return extract_echoes(recording, parameters), nothing_suspect
    lenient = replace(parameters.echo, found_share=0.0, clipped_share=1.0)
    frames = _frames(recording, replace(parameters, echo=lenient))
    ran_s, spoiled = duration_s(recording), _spoiled(frames, parameters)
    facts = frame_facts(frames, lenient, ran_s, recording.gain_db)
    every = clean = echoes_of(frames, lenient, ran_s)
    if spoiled is not None and len(spoiled) >= 2:
        ends = np.isin(np.arange(len(spoiled)), [0, len(spoiled) - 1])  # they say how long it is
        clean = echoes_of(frames, lenient, ran_s, spoiled & ~ends)
    return clean, suspicion(facts, every, parameters.spoofing, clean)


def apply_acoustic_scale(nodes: Odometry, echoes: Echoes, parameters: Parameters) -> Odometry:
    """The walk with its steps as long as the echoes say, weighed against what is known of them.

    As it was where nothing about the steps is uncertain, or the sound cannot tell.
    """
    if not nodes.scale_sigma:
        return nodes
    chirp = make_chirp(parameters.chirp, ECHO_RATE_HZ)
    measured = measure_scale(echoes, nodes, chirp, parameters.acoustic_odometry)
    return rescaled(nodes, with_prior(measured, nodes.scale_sigma))


def _frames(recording: Recording, parameters: Parameters) -> Frames:
    if recording.audio is None:
        raise InputError(
            f"{recording.name}: it has no sound; map it by magnetic, or record while chirping",
            argument="by",
        )
    chirp = make_chirp(parameters.chirp, recording.audio.rate_hz)
    return find_frames(recording.audio, chirp, parameters.echo, recording.played_t_s)


def _spoiled(frames: Frames, parameters: Parameters) -> Bool | None:
    if not frames.scheduled:
        return None
    return spoiled_frames(frames.envelope, frames.arrivals.samples, parameters.medium_access)
