"""The page's motion and growing map run in node, for the studies that compare them."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from elfslam.base.errors import InputError
from elfslam.base.values import Imu

SCRIPT = Path(__file__).with_suffix(".mjs")


def in_node(verb: str, given: dict[str, Any]) -> Any:
    """What a verb of page_motion.mjs says. Raises InputError where node is not installed."""
    if shutil.which("node") is None:
        raise InputError("node is missing; the page's modules run in it (Debian: nodejs)")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "given.json"
        file.write_text(json.dumps(given))
        command = ["node", str(SCRIPT), verb, str(file)]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout)


def readings(imu: Imu) -> dict[str, list[float]]:
    """Motion as the page holds it."""
    rows = {"tS": imu.t_s, "accelMps2": imu.accel_mps2, "gyroRadps": imu.gyro_radps}
    return {name: values.ravel().tolist() for name, values in rows.items()}
