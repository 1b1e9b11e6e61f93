"""Every module that comes with an extra names it."""

from __future__ import annotations

import ast
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from elfslam.base.extras import extra_with

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
ALWAYS_THERE = {
    "elfslam", "numpy", "scipy", "numba", "onnxruntime", "gtsam", "threadpoolctl",
    "soundfile", "typer", "rich", "plotly",
}  # fmt: skip


def imported() -> Iterator[str]:
    """All modules that the package imports from somewhere else."""
    for file in (ROOT / "src" / "elfslam").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                yield from (alias.name.partition(".")[0] for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                yield (node.module or "").partition(".")[0]


def test_whatever_may_be_missing_is_in_an_extra() -> None:
    others = set(imported()) - set(sys.stdlib_module_names) - ALWAYS_THERE
    assert {"torch", "fastapi", "PIL", "ray", "faiss"} <= others
    extras = set(PROJECT["optional-dependencies"]) - {"test"}
    assert {name: extra_with(name) for name in others if extra_with(name) not in extras} == {}


@pytest.mark.parametrize(
    ("module", "extra"),
    [
        ("torch", "learn"),
        ("onnx.helper", "learn"),
        ("PIL.Image", "images"),
        ("starlette", "serve"),
        ("psycopg", "postgres"),
        ("s3fs", "buildings"),
        ("numpy", None),
        ("torchvision", None),
        ("shapely", None),
        ("elfslam.nowhere", None),
        ("", None),
    ],
)
def test_an_extra_is_the_first_that_brings_the_module(module: str, extra: str | None) -> None:
    assert extra_with(module) == extra
