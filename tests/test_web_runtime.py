"""The browser's runtime is pinned, and its lock names no host."""

from __future__ import annotations

import json
import re
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "studies" / "benchmarks" / "web_runtime"


def test_the_lock_holds_what_the_package_pins() -> None:
    pinned = json.loads((FOLDER / "package.json").read_text())["dependencies"]
    locked = json.loads((FOLDER / "package-lock.json").read_text())["packages"]
    for name, version in pinned.items():
        assert re.fullmatch(r"\d+\.\d+\.\d+", version), "one version, not a range"
        assert locked[f"node_modules/{name}"]["version"] == version


def test_every_package_is_held_by_its_content_and_not_by_a_place() -> None:
    text = (FOLDER / "package-lock.json").read_text()
    assert "resolved" not in text
    assert "://" not in text
    packages = json.loads(text)["packages"]
    assert all(item["integrity"].startswith("sha512-") for name, item in packages.items() if name)


def test_the_page_carries_the_pinned_runtime_with_its_licence() -> None:
    pages = FOLDER.parents[2] / "src" / "elfslam" / "serve" / "pages"
    vendored = pages / "vendor" / "onnxruntime-web"
    version = json.loads((FOLDER / "package.json").read_text())["dependencies"]["onnxruntime-web"]
    assert f"ONNX Runtime Web v{version}\n" in (vendored / "ort.wasm.min.mjs").read_text()[:200]
    assert (vendored / "ort-wasm-simd-threaded.wasm").read_bytes().startswith(b"\0asm")
    assert "MIT License" in (vendored / "LICENSE").read_text()
