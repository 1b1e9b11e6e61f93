"""The encoder in Chromium, in a worker and under the server's content policy, against Python."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from elfslam.serve.people.guards import CONTENT_POLICY
from elfslam.slam.front_end import extract_echoes
from elfslam.slam.parameters import Parameters
from elfslam.stages.feature import OnnxEncoder, load_encoder
from elfslam.world.simulate import load_world, simulate

pytestmark = pytest.mark.real

HERE = Path(__file__).parent
PAGES = HERE.parents[3] / "src" / "elfslam" / "serve" / "pages"
TYPES = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".mjs": "text/javascript",
    ".wasm": "application/wasm",
}
COUNT = 20


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Echoes of a walk, and the encoder."""
    folder = tmp_path_factory.mktemp("given")
    recording, _ = simulate(load_world("studio"), 102, rounds=1)
    traces = extract_echoes(recording, Parameters()).samples[:COUNT]
    traces.astype("<f4").tofile(folder / "traces.f32")
    encoder = load_encoder("compact")
    assert isinstance(encoder, OnnxEncoder)
    (folder / "encoder.onnx").write_bytes(encoder.content)
    return folder


@pytest.fixture(scope="module")
def said(given: Path, browser: Any) -> dict[str, Any]:
    """What the worker says."""
    folders = {"test": HERE, "given": given}

    def answer(route: Any) -> None:
        path = route.request.url.partition("localhost/")[2]
        first, _, rest = path.partition("/")
        file = folders[first] / rest if first in folders else PAGES / path
        kind = TYPES.get(file.suffix, "application/octet-stream")
        headers = {"Content-Type": kind, "Content-Security-Policy": CONTENT_POLICY}
        route.fulfill(body=file.read_bytes(), headers=headers)

    context = browser.new_context()
    context.route("http://localhost/**", answer)
    page = context.new_page()
    page.goto("http://localhost/test/encoder.html")
    page.wait_for_selector("#result:not(:empty)", timeout=60_000)
    told: dict[str, Any] = json.loads(page.inner_text("#result"))
    context.close()
    assert "failed" not in told, told["failed"]
    return told


def test_a_browser_makes_the_elfs_of_python(said: dict[str, Any], given: Path) -> None:
    encoder = load_encoder("compact")
    assert isinstance(encoder, OnnxEncoder)
    traces = np.fromfile(given / "traces.f32", "<f4").reshape(-1, 2352)
    assert said["identity"] == encoder.identity
    assert np.abs(np.array(said["together"]) - encoder.embed(traces).ravel()).max() < 1e-4


def test_an_echo_alone_is_what_it_is_among_others(said: dict[str, Any]) -> None:
    assert np.abs(np.array(said["alone"]) - np.array(said["together"])[:128]).max() < 1e-5
