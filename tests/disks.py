"""File systems of a test's own."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def mounted(place: Path, **options: object) -> Iterator[Path]:
    """A tmpfs at a folder, which is made; skips the test where none may be mounted.

    Options are mount's: size="8m", ro="".
    """
    place.mkdir(parents=True, exist_ok=True)
    told = ",".join(f"{name}={value}" if value != "" else name for name, value in options.items())
    command = ["mount", "-t", "tmpfs", "-o", told, "tmpfs", str(place)]
    if subprocess.run(command, capture_output=True, check=False).returncode != 0:
        pytest.skip("no file system can be mounted here")
    try:
        yield place
    finally:
        subprocess.run(["umount", "--lazy", str(place)], capture_output=True, check=False)
