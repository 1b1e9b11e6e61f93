"""Page modules run by node."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

node = shutil.which("node")
needs_node = pytest.mark.skipif(node is None, reason="node is missing: install nodejs")


def run_node(*arguments: object, **environment: object) -> subprocess.CompletedProcess[str]:
    """What came of a command of node."""
    told = {name: str(value) for name, value in environment.items()}
    return subprocess.run(
        [str(node), *map(str, arguments)], capture_output=True, text=True, timeout=120,
        check=False, env={**os.environ, **told},
    )  # fmt: skip


def passed_in_node(file: Path, **environment: object) -> int:
    """How many tests of a file passed; that none failed is asserted here."""
    done = run_node("--test", file, **environment)
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
    assert "# fail 0" in done.stdout
    passed = int(re.search(r"^# pass (\d+)$", done.stdout, re.M)[1])
    assert passed > 0, f"{file}: no test ran"
    return passed


def agrees_in_node(file: Path, vectors: object, folder: Path) -> int:
    """How many tests of a file passed on vectors, which are put into a folder for them."""
    told = folder / "vectors.json"
    told.write_text(json.dumps(vectors))
    return passed_in_node(file, ELFSLAM_VECTORS=told)
