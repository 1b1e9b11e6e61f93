"""Phones in a small city find their floor; the benchmark runs, small, against a real server."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from studies.benchmarks.own_postgresql import initdb

pytestmark = pytest.mark.real

ROOT = Path(__file__).resolve().parents[3]


def test_the_benchmark_small() -> None:
    pytest.importorskip("psycopg")
    if initdb() is None:
        pytest.skip("PostgreSQL is not installed (Debian: apt-get install postgresql)")
    command = [
        sys.executable,
        "-m",
        "studies.benchmarks.two_hundred_phones",
        "--buildings",
        "8",
        "--seconds",
        "2",
        "--rates",
        "20",
    ]
    command += ["--senses", "wifi,position,both,echoes,mixed"]
    done = subprocess.run(
        [*command, "--json"], check=True, capture_output=True, text=True, timeout=300, cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    decoder = json.JSONDecoder()
    sizes, end = decoder.raw_decode(done.stdout)
    rows = json.loads(done.stdout[end:])
    assert any("floors (32)" in name for name in sizes[0])
    assert [row["by"] for row in rows] == ["wifi", "position", "both", "echoes", "mixed"]
    for row in rows:
        assert row["asked"] == 40
        assert row["errors"] == 0
        assert 0 < row["median ms"] <= row["99 % ms"]
        shares = {name: float(str(row[name]).rstrip("%")) for name in ("OK", "OK wrong")}
        assert shares["OK wrong"] <= 5
        if row["by"] in ("wifi", "both"):
            assert shares["OK"] > 40
