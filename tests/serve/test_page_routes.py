"""The pages' files over HTTP: compressed, known by their content, in ranges, and listed."""

import asyncio
import gzip
import hashlib
import itertools
import json
import os
import random
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image
from starlette.datastructures import Headers
from starlette.testclient import TestClient
from starlette.types import Message, Scope

from elfslam.serve.app import create_app
from elfslam.serve.page_routes import PIECE_BYTES, PageFiles, takes_gzip
from elfslam.serve.services import open_services
from elfslam.serve.settings import PAGES_FOLDER, ServerSettings
from tests.serve.conftest import asking

TEXT = "export const words = 'again and again';\n" * 50
FILES = {
    "phone.html": "<p>phone</p>" * 20,
    "desk.html": "desk",
    "style.css": "p {}",
    "app.webmanifest": "{}",
    "service_worker.js": "self;",
    "phone/main.js": TEXT,
    "phone/short.js": "1;",
    "shared/icon.png": "no picture",
    "words/de.json": "{}",
    "desk/main.js": TEXT,
    "vendor/runtime/run.wasm": "wasm" * 100,
    "vendor/runtime/LICENSE": "free",
    "vendor/qrcode-generator/qrcode.mjs": TEXT,
}
PLAIN, ZIPPED = {"Accept-Encoding": "identity"}, {"Accept-Encoding": "br, gzip"}


@pytest.fixture
def pages(tmp_path: Path) -> Path:
    folder = tmp_path / "pages"
    for name, content in FILES.items():
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(content)
    return folder


@pytest.fixture
def client(settings: ServerSettings, pages: Path) -> Iterator[TestClient]:
    app = create_app(open_services(replace(settings, pages_folder=pages)))
    yield asking(app)
    app.state.services.engine.dispose()


def sent(client: TestClient, path: str, headers: dict[str, str]) -> tuple[bytes, Headers]:
    """The bytes that went over the network."""
    with client.stream("GET", path, headers=headers) as answer:
        return b"".join(answer.iter_raw()), answer.headers


def test_text_is_sent_compressed_to_whoever_takes_that(client: TestClient) -> None:
    content, headers = sent(client, "/phone/main.js", ZIPPED)
    assert gzip.decompress(content).decode() == TEXT
    assert headers["content-encoding"] == "gzip"
    assert headers["content-length"] == str(len(content))
    assert headers["vary"] == "Accept-Encoding"
    assert headers["content-type"].startswith("text/javascript")
    plain, others = sent(client, "/phone/main.js", PLAIN)
    assert plain.decode() == TEXT
    assert "content-encoding" not in others
    assert others["vary"] == "Accept-Encoding"
    assert others["content-length"] == str(len(TEXT))
    assert others["etag"] != headers["etag"]


@pytest.mark.anyio
async def test_who_is_slow_makes_the_server_hold_little(tmp_path: Path) -> None:
    text = random.Random(0).randbytes(4 * PIECE_BYTES).hex()
    (tmp_path / "large.js").write_text(text)
    held: list[bytes] = []

    async def keep(message: Message) -> None:
        held.append(message.get("body", b""))

    async def leave() -> Message:
        await asyncio.Event().wait()
        raise AssertionError

    asked = [(b"accept-encoding", b"gzip")]
    scope: Scope = {"type": "http", "method": "GET", "path": "/large.js", "headers": asked}
    await (await PageFiles(tmp_path).get_response("large.js", scope))(scope, leave, keep)
    assert gzip.decompress(b"".join(held)).decode() == text
    assert len(held) > 4
    assert max(map(len, held)) == PIECE_BYTES


def test_pages_and_their_kinds(client: TestClient) -> None:
    assert client.get("/").text == FILES["phone.html"]
    assert client.get("/desk").text == "desk"
    for path, kind in (
        ("/phone/main.js", "text/javascript"),
        ("/vendor/qrcode-generator/qrcode.mjs", "text/javascript"),
        ("/vendor/runtime/run.wasm", "application/wasm"),
    ):
        assert client.get(path).headers["content-type"].partition(";")[0] == kind
    assert client.get("/phone/main.js").headers["cache-control"] == "no-cache"


def test_what_does_not_get_smaller_is_sent_as_it_is(client: TestClient) -> None:
    for path in ("/phone/short.js", "/shared/icon.png"):
        _, headers = sent(client, path, ZIPPED)
        assert "content-encoding" not in headers
        assert "vary" not in headers


@pytest.mark.parametrize("headers", [PLAIN, ZIPPED])
def test_an_etag_saves_sending_it_again(
    client: TestClient, pages: Path, headers: dict[str, str]
) -> None:
    tag = client.get("/phone/main.js", headers=headers).headers["etag"]
    for known in (tag, f'"x", W/{tag}'):
        again = client.get("/phone/main.js", headers={**headers, "If-None-Match": known})
        assert (again.status_code, again.content) == (304, b"")
        assert again.headers["etag"] == tag
        assert again.headers["vary"] == "Accept-Encoding"
    (pages / "phone/main.js").write_text(TEXT[::-1])
    changed = client.get("/phone/main.js", headers={**headers, "If-None-Match": tag})
    assert (changed.status_code, changed.text) == (200, TEXT[::-1])


def test_an_etag_is_of_the_content_and_of_nothing_else(client: TestClient, pages: Path) -> None:
    tag = client.get("/phone/main.js").headers["etag"]
    os.utime(pages / "phone/main.js", (1, 1))
    assert client.get("/phone/main.js").headers["etag"] == tag
    assert client.get("/desk/main.js").headers["etag"] == tag


def test_ranges_are_of_the_plain_file(client: TestClient) -> None:
    answer = client.get("/phone/main.js", headers={**ZIPPED, "Range": "bytes=7-11"})
    assert (answer.status_code, answer.text) == (206, TEXT[7:12])
    assert "content-encoding" not in answer.headers
    assert answer.headers["content-range"] == f"bytes 7-11/{len(TEXT)}"
    zipped = client.get("/phone/main.js", headers=ZIPPED).headers["etag"]
    asked = {**ZIPPED, "Range": "bytes=7-11", "If-Range": zipped}
    assert client.get("/phone/main.js", headers=asked).status_code == 200
    asked["If-Range"] = answer.headers["etag"]
    assert client.get("/phone/main.js", headers=asked).status_code == 206
    assert client.get("/phone/main.js", headers={"Range": "bytes=9999-"}).status_code == 416


def test_head_tells_what_get_would(client: TestClient) -> None:
    for path, headers in itertools.product(("/", "/phone/main.js"), (PLAIN, ZIPPED)):
        got, head = client.get(path, headers=headers), client.head(path, headers=headers)
        assert (head.status_code, head.content) == (200, b"")
        for name in ("content-length", "etag", "vary", "content-type"):
            assert head.headers[name] == got.headers[name]


def test_what_is_not_there(client: TestClient, pages: Path) -> None:
    assert client.get("/phone/none.js").status_code == 404
    assert client.get("/phone").status_code == 404
    assert client.post("/phone/main.js").status_code == 405
    (pages / "desk.html").unlink()
    assert "install elfslam again" in client.get("/desk").json()["detail"]


def test_the_list_is_what_the_phone_needs(client: TestClient) -> None:
    told = client.get("/precache.json").json()
    paths = {file["path"]: file for file in told["files"]}
    assert set(paths) == {
        "/", "/style.css", "/app.webmanifest", "/phone/main.js", "/phone/short.js",
        "/shared/icon.png", "/vendor/runtime/run.wasm", "/words/de.json",
        "/stages/encoder.onnx", "/stages/parameters.json",
    }  # fmt: skip
    for path, file in paths.items():
        content, headers = sent(client, path, ZIPPED)
        assert len(content) == file["sent_bytes"]
        whole = gzip.decompress(content) if "content-encoding" in headers else content
        assert len(whole) == file["size_bytes"]
        assert hashlib.sha256(whole).hexdigest() == file["sha256"]
    for name in ("size_bytes", "sent_bytes"):
        assert told[name] == sum(file[name] for file in told["files"])


def test_a_new_version_of_any_file_is_a_new_worker(client: TestClient, pages: Path) -> None:
    worker, version = client.get("/service_worker.js"), client.get("/precache.json").json()
    assert worker.headers["content-type"].startswith("text/javascript")
    assert worker.headers["cache-control"] == "no-cache"
    assert worker.text == f'const VERSION = "{version["version"]}";\nself;'
    (pages / "desk/main.js").write_text("")
    assert client.get("/service_worker.js").text == worker.text
    (pages / "vendor/runtime/run.wasm").write_text("another")
    assert client.get("/service_worker.js").text != worker.text


def test_who_takes_gzip() -> None:
    for told in ("gzip", "br, GZIP;q=0.5", "*"):
        assert takes_gzip(Headers({"accept-encoding": told})), told
    for told in ("gzip;q=0", "gzip; q=0.000", "br", "", "x-gzip2"):
        assert not takes_gzip(Headers({"accept-encoding": told})), told


def test_the_page_can_be_put_on_the_home_screen() -> None:
    told = json.loads((PAGES_FOLDER / "app.webmanifest").read_text())
    assert 'rel="manifest" href="app.webmanifest"' in (PAGES_FOLDER / "phone.html").read_text()
    for icon in told["icons"]:
        file = PAGES_FOLDER / icon["src"]
        if icon["type"] == "image/png":
            with Image.open(file) as image:
                assert icon["sizes"] == "{}x{}".format(*image.size)
        else:
            assert file.read_text().startswith("<svg")


def test_browsers_get_a_page_at_an_address_that_leads_nowhere(
    client: TestClient, pages: Path
) -> None:
    browser = {"Accept": "text/html,application/xhtml+xml,*/*;q=0.8"}
    assert client.get("/none", headers=browser).headers["content-type"].startswith("application/p")
    (pages / "missing.html").write_text("<h1>There is no such page</h1>")
    for path in ("/none", "/phone/none.js", "/desk/maps/1"):
        answer = client.get(path, headers=browser)
        assert (answer.status_code, answer.text) == (404, "<h1>There is no such page</h1>")
        assert answer.headers["content-type"].startswith("text/html")
        assert "default-src 'self'" in answer.headers["content-security-policy"]
        assert client.head(path, headers=browser).status_code == 404
    for path, headers in (("/none", {}), ("/api/none", browser), ("/api/maps/x/y", browser)):
        answer = client.get(path, headers=headers)
        assert answer.status_code == 404
        assert answer.headers["content-type"] == "application/problem+json"
    assert "/missing.html" not in {
        row["path"] for row in client.get("/precache.json").json()["files"]
    }
