"""A recording cut to a stretch of itself; its times stay those of the whole."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elfslam.base.errors import InputError
from elfslam.base.values import Audio, Imu, Odometry, Recording
from elfslam.slam.coverage import motion_times_s

SLIGHT_S = 0.15
"""Sound that differs by no more from the motion in length lacks nothing that matters."""


def trimmed(recording: Recording, from_s: float, until_s: float) -> Recording:
    """The recording of which only a stretch counts.

    Whoever was declared to stand somewhere did so when the whole began: a stretch that begins
    later has no declared start.
    """
    start = recording.start_pose if from_s <= 0 else None
    return replace(recording, kept_s=(from_s, until_s), start_pose=start)


def kept_motion(recording: Recording) -> Recording:
    """A recording whose motion is cut to the stretch that counts. Raises InputError without any."""
    if recording.kept_s is None:
        return recording
    imu = _cut_imu(recording.imu, recording.kept_s)
    odometry = _cut_odometry(recording.odometry, recording.kept_s)
    if not any(each is not None and len(each.t_s) for each in (imu, odometry)):
        t_s = motion_times_s(recording)
        ran = "none" if t_s is None else f"that from {t_s[0]:.1f} to {t_s[-1]:.1f} s"
        from_s, until_s = recording.kept_s
        raise InputError(
            f"{recording.name}: wanted motion from {from_s:g} to {until_s:g} s, got {ran}; choose "
            "a stretch in which the phone was carried"
        )
    return replace(recording, imu=imu, odometry=odometry)


def kept_sound(recording: Recording, audio: Audio, duration_s: float | None) -> Audio:
    """The sound, silent outside the stretch that counts, so that nothing there is judged.

    Sound that may lack samples, as it is not as long as the motion (`duration_s`), stays whole:
    its breaks tell when later chirps were heard.
    """
    if recording.kept_s is None:
        return audio
    length_s = audio.samples.shape[1] / audio.rate_hz
    if abs((duration_s or length_s) - length_s) > SLIGHT_S:
        return audio
    first, last = np.round(np.clip(recording.kept_s, 0, length_s) * audio.rate_hz).astype(int)
    samples = np.zeros_like(audio.samples)
    samples[:, first:last] = audio.samples[:, first:last]
    return replace(audio, samples=samples)


def _cut_imu(imu: Imu | None, kept_s: tuple[float, float]) -> Imu | None:
    if imu is None:
        return None
    rows = (imu.t_s >= kept_s[0]) & (imu.t_s <= kept_s[1])
    return Imu(imu.t_s[rows], imu.accel_mps2[rows], imu.gyro_radps[rows])


def _cut_odometry(odometry: Odometry | None, kept_s: tuple[float, float]) -> Odometry | None:
    if odometry is None:
        return None
    rows = np.flatnonzero((odometry.t_s >= kept_s[0]) & (odometry.t_s <= kept_s[1]))
    return replace(
        odometry,
        t_s=odometry.t_s[rows],
        world_from_body=odometry.world_from_body[rows],
        step_sigma=odometry.step_sigma[rows[:-1]],
    )
