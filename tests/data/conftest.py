"""A small recording with every sensor, its truth, and the run made from it."""

import numpy as np
import pytest

from elfslam.base import values


@pytest.fixture
def recording() -> values.Recording:
    """Two seconds of every sensor."""
    generator = np.random.default_rng(0)
    t_s = np.arange(100) / 50
    quaternion = generator.standard_normal((100, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    rssi = np.array([[-50.0, np.nan, -70.0], [np.nan, -61.5, -71.0]])
    return values.Recording(
        name="hall",
        device="test phone",
        start_pose=(1.0, -2.0, 0.5),
        audio=values.Audio(generator.uniform(-1, 1, (2, 22_050)), 44_100),
        imu=values.Imu(
            t_s, generator.normal([0, 0, 9.8], 1, (100, 3)), generator.normal(0, 1, (100, 3))
        ),
        orientation=values.Orientation(t_s, quaternion),
        odometry=_odometry(generator),
        magnetometer=values.Magnetometer(t_s + 0.003, generator.normal(30, 5, (100, 3))),
        wifi=values.WifiScans(np.array([0.5, 1.5]), ("aa", "bb", "cc"), rssi, np.abs(rssi) / 100),
        emr=values.Emr(t_s, generator.uniform(0, 1, (100, 4))),
    )


def _odometry(generator: np.random.Generator) -> values.Odometry:
    poses = np.column_stack([generator.normal(0, 5, (6, 2)), generator.uniform(-3, 3, 6)])
    return values.Odometry(np.arange(6) * 0.5, poses, generator.uniform(0.01, 0.1, (5, 3)))


@pytest.fixture
def truth() -> values.Truth:
    """Poses with heading."""
    return values.Truth([0.0, 1.0, 2.0], np.array([[0, 0, 0.1], [1, 0, 3.0], [1, 1, -3.0]]))


@pytest.fixture
def run() -> values.Run:
    """A run of six footsteps with two closures and a map of two modalities."""
    generator = np.random.default_rng(1)
    odometry = _odometry(generator)
    spread = np.eye(3) * 0.01
    vectors = generator.standard_normal((30, 8))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    echo_t_s = np.arange(30) * 0.1
    samples = 1e-3 * generator.standard_normal((30, values.ECHO_SAMPLES))
    moves, covariance = generator.standard_normal((2, 3)), np.stack([spread, 2 * spread])
    return values.Run(
        name="hall",
        odometry=odometry,
        similarity=values.Similarity(generator.uniform(-1, 1, (6, 6)), "elf"),
        closures=values.Closures([0, 1], [4, 5], [0.5, 0.75], moves, covariance),
        trajectory=values.Trajectory(
            odometry.t_s, odometry.world_from_body, np.tile(spread, (6, 1, 1)), [1.0, 0.0], "OK"
        ),
        floor_map=_floor_map(generator),
        echoes=values.Echoes(echo_t_s, samples, np.empty((0, 2))),
        features=values.Features(echo_t_s, vectors, "compact", attenuation=0.9),
        seconds={"echo": 0.5, "graph": 0.25},
    )


def _floor_map(generator: np.random.Generator) -> values.FloorMap:
    return values.FloorMap(
        xy_m=generator.standard_normal((5, 2)),
        heading_rad=np.linspace(-1, 1, 5),
        walk=np.zeros(5),
        order=np.arange(5),
        covariance_m2=np.tile(np.eye(2), (5, 1, 1)),
        payloads=(
            values.Payload("elf", "compact", generator.standard_normal((5, 8))),
            values.Payload("wifi", "", generator.standard_normal((5, 3))),
        ),
        parameters_digest="abc",
        sources=("hall",),
    )
