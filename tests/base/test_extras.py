"""Every module that comes with an extra names it."""

import ast
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from elfslam.base.extras import TARGETS, extra_with, installing

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


def test_the_makefile_installs_what_errors_say_that_it_does() -> None:
    rules = (ROOT / "Makefile").read_text().split("\n\n")
    for extra, command in TARGETS.items():
        target = command.removeprefix("make ")
        rule = next(each for each in rules if each.startswith(f"$(VENV)/.installed-{target}:"))
        assert extra in rule.partition(".[")[2].partition("]")[0].split(","), extra


def test_an_extra_without_a_target_is_installed_by_pip() -> None:
    assert installing("learn") == "run make studies in the checkout"
    assert "--editable '.[postgres]' in the checkout" in installing("postgres")
