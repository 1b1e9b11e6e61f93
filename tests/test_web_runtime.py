"""What comes from npm is pinned, and no lock names a host."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
RUNTIME, TOOLS = ROOT / "studies" / "benchmarks" / "web_runtime", ROOT / "tests" / "javascript"
FOLDERS = pytest.mark.parametrize("folder", [RUNTIME, TOOLS], ids=lambda folder: folder.name)


@FOLDERS
def test_the_lock_holds_what_the_package_pins(folder: Path) -> None:
    package = json.loads((folder / "package.json").read_text())
    pinned = package.get("dependencies", {}) | package.get("devDependencies", {})
    locked = json.loads((folder / "package-lock.json").read_text())["packages"]
    for name, version in pinned.items():
        assert re.fullmatch(r"\d+\.\d+\.\d+", version), "one version, not a range"
        assert locked[f"node_modules/{name}"]["version"] == version


@FOLDERS
def test_every_package_is_held_by_its_content_and_not_by_a_place(folder: Path) -> None:
    packages = json.loads((folder / "package-lock.json").read_text())["packages"]
    assert all(item["integrity"].startswith("sha512-") for name, item in packages.items() if name)
    assert not any("resolved" in item for item in packages.values())
    assert "omit-lockfile-registry-resolved=true" in (folder / ".npmrc").read_text()


def test_the_page_carries_the_pinned_runtime_with_its_licence() -> None:
    pages = ROOT / "src" / "elfslam" / "serve" / "pages"
    vendored = pages / "vendor" / "onnxruntime-web"
    version = json.loads((RUNTIME / "package.json").read_text())["dependencies"]["onnxruntime-web"]
    assert f"ONNX Runtime Web v{version}\n" in (vendored / "ort.wasm.min.mjs").read_text()[:200]
    assert (vendored / "ort-wasm-simd-threaded.wasm").read_bytes().startswith(b"\0asm")
    assert "MIT License" in (vendored / "LICENSE").read_text()
