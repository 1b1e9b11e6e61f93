"""The pages of phone and desk, compressed once, and the certificate that makes browsers trust."""

from __future__ import annotations

import asyncio
import gzip
import hashlib
import json
import mimetypes
import threading
from collections.abc import AsyncIterator, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from os import PathLike, stat_result
from pathlib import Path

from fastapi import FastAPI, Request
from pydantic import BaseModel
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.responses import FileResponse, Response, StreamingResponse
from starlette.routing import Match, Mount
from starlette.staticfiles import NotModifiedResponse, StaticFiles
from starlette.types import Scope

from elfslam.serve.maps.package import GROUPS_OF_WALK, phone_parameters
from elfslam.serve.problems import Problem, problems
from elfslam.serve.services import ServicesDep
from elfslam.serve.settings import ServerSettings
from elfslam.stages.feature import SHIPPED_ENCODER

COMPRESSED = frozenset((".html", ".css", ".js", ".mjs", ".svg", ".webmanifest", ".wasm", ".json"))
LEVEL = 6
"""Of gzip; the highest gains 1 % and takes three times as long."""
WORTH = 0.95
"""A copy that is not smaller than this share is not sent."""
PIECE_BYTES = 2**16
PHONE_PAGE, MISSING_PAGE = "phone.html", "missing.html"
OF_PHONE = ("phone", "shared", "keeping", "stages", "words", "vendor")
"""Folders that the phone page needs without a network; `vendor` less what the desk alone needs."""
ALONE = (PHONE_PAGE, "style.css", "app.webmanifest")
NOT_OF_PHONE = ("vendor/qrcode-generator",)
KEPT = frozenset((*COMPRESSED, ".png", ".onnx"))
"""Licences and the like stay on the server."""

Stamp = tuple[int, int]


@dataclass(frozen=True)
class Copy:
    """What a file is known by, and its compressed copy where that is smaller."""

    sha256: str
    size_bytes: int
    zipped: bytes | None

    @property
    def sent_bytes(self) -> int:
        """What goes over the network."""
        return self.size_bytes if self.zipped is None else len(self.zipped)

    def tag(self, *, zipped: bool) -> str:
        """The ETag of one of the two."""
        return f'"{self.sha256[:32]}{"-gzip" if zipped else ""}"'


class PageFiles(StaticFiles):
    """Static files with strong ETags, compressed for whoever takes that, in ranges for others.

    `beside` names files of other folders that have an address among those of the pages.
    """

    def __init__(self, folder: Path, beside: Mapping[str, Path] | None = None) -> None:
        super().__init__(directory=folder, check_dir=False)
        self._folder, self._lock = folder, threading.Lock()
        self._beside = dict(beside or {})
        self._copies: dict[Path, tuple[Stamp, Copy]] = {}
        self._alone: dict[Path, threading.Lock] = {}

    async def get_response(self, path: str, scope: Scope) -> Response:
        """A file, or that it has not changed; a page for browsers at an address that leads nowhere.

        Raises HTTPException, also where nobody asked for a page.
        """
        try:
            response = await super().get_response(path, scope)
        except HTTPException as error:
            missing = self._folder / MISSING_PAGE
            if error.status_code != 404 or not wants_page(Headers(scope=scope), missing):
                raise
            return FileResponse(missing, status_code=404)
        if not isinstance(response, FileResponse):
            return response
        try:
            copy = await run_in_threadpool(self.copy_of, Path(response.path))
        except FileNotFoundError as error:
            raise HTTPException(404) from error
        return self._answer(response, copy, Headers(scope=scope), scope["method"])

    def lookup_path(self, path: str) -> tuple[str, stat_result | None]:
        """Where the file of an address lies."""
        file = self._beside.get(path)
        return super().lookup_path(path) if file is None else (str(file), file.stat())

    def file_response(
        self,
        full_path: str | PathLike[str],
        stat_result: stat_result,
        scope: Scope,
        status_code: int = 200,
    ) -> Response:
        """The file as it is; whether it is wanted so is seen later."""
        return FileResponse(full_path, status_code=status_code, stat_result=stat_result)

    def _answer(self, plain: FileResponse, copy: Copy, asked: Headers, method: str) -> Response:
        zipped = copy.zipped if takes_gzip(asked) and "range" not in asked else None
        headers = {"ETag": copy.tag(zipped=zipped is not None)}
        if copy.zipped is not None:
            headers["Vary"] = "Accept-Encoding"
        plain.headers.update(headers)
        if self.is_not_modified(plain.headers, asked):
            return NotModifiedResponse(plain.headers)
        if zipped is None:
            return plain
        headers |= {"Content-Encoding": "gzip", "Content-Length": str(len(zipped))}
        headers["Last-Modified"] = plain.headers["last-modified"]
        if method == "HEAD":
            return Response(None, 200, headers, plain.media_type)
        return StreamingResponse(_pieces(zipped), 200, headers, plain.media_type)

    def copy_of(self, file: Path) -> Copy:
        """What is known of a file, found out anew when it changed. Raises FileNotFoundError."""
        about = file.stat()
        stamp = about.st_mtime_ns, about.st_size
        with self._lock:  # short: nobody waits for a large file but who wants that file
            alone = self._alone.setdefault(file, threading.Lock())
        with alone:
            known = self._copies.get(file)
            if known is None or known[0] != stamp:
                known = self._copies[file] = stamp, _copied(file)
        return known[1]

    def page_files(self) -> PageList:
        """The files that the phone page keeps, so that it opens without a network."""
        files = {name: self._folder / name for name in self._names()} | self._beside
        rows = [_row(name, self.copy_of(file)) for name, file in sorted(files.items())]
        told = "".join(f"{row.path} {row.sha256}\n" for row in rows)
        return PageList(
            version=hashlib.sha256(told.encode()).hexdigest()[:16],
            size_bytes=sum(row.size_bytes for row in rows),
            sent_bytes=sum(row.sent_bytes for row in rows),
            files=rows,
        )

    async def page(self, name: str, request: Request) -> Response:
        """A page at a short address."""
        try:
            return await self.get_response(name, request.scope)
        except HTTPException as error:
            raise Problem(404, f"this installation has no {name}; install elfslam again") from error

    def worker(self) -> Response:
        """The service worker, another one whenever a file of the page is."""
        told = f'const VERSION = "{self.page_files().version}";\n'
        script = (self._folder / WORKER).read_text(encoding="utf-8")
        return Response(told + script, media_type=TYPES[".js"])

    def _names(self) -> Iterator[str]:
        folders = (file for name in OF_PHONE for file in (self._folder / name).rglob("*"))
        for file in sorted([*(self._folder / name for name in ALONE), *folders]):
            name = file.relative_to(self._folder).as_posix()
            if file.suffix in KEPT and file.is_file() and not name.startswith(NOT_OF_PHONE):
                yield name


def _row(name: str, copy: Copy) -> PageFile:
    path = "/" if name == PHONE_PAGE else f"/{name}"
    sizes = {"size_bytes": copy.size_bytes, "sent_bytes": copy.sent_bytes}
    return PageFile(path=path, sha256=copy.sha256, **sizes)


def wants_page(asked: Headers, page: Path) -> bool:
    """Whether it is a browser that opens an address, and there is that page to answer it with."""
    return "text/html" in asked.get("accept", "").lower() and page.is_file()


def takes_gzip(asked: Headers) -> bool:
    """Whether whoever asks takes gzip (RFC 9110, 12.5.3)."""
    for entry in asked.get("accept-encoding", "").lower().split(","):
        name, _, weight = entry.replace(" ", "").partition(";q=")
        if name in ("gzip", "*"):
            return weight.strip("0.") != "" if weight else True
    return False


async def _pieces(content: bytes) -> AsyncIterator[bytes]:
    """Pieces, so that few wait in memory for whoever is slow, and nobody for whoever is fast."""
    for begin in range(0, len(content), PIECE_BYTES):
        yield content[begin : begin + PIECE_BYTES]
        await asyncio.sleep(0)


def _copied(file: Path) -> Copy:
    content = file.read_bytes()
    zipped = gzip.compress(content, LEVEL, mtime=0) if file.suffix in COMPRESSED else content
    worth = len(zipped) < WORTH * len(content)
    return Copy(hashlib.sha256(content).hexdigest(), len(content), zipped if worth else None)


PAGES = {"/": "phone.html", "/desk": "desk.html", "/trust": "trust.html"}
CERTIFICATE, WORKER, PARAMETERS = "authority.pem", "service_worker.js", "parameters.json"
TYPES = {
    ".js": "text/javascript",
    ".mjs": "text/javascript",
    ".wasm": "application/wasm",
    ".webmanifest": "application/manifest+json",
    ".onnx": "application/octet-stream",
    ".phyphox": "application/octet-stream",
}


class PageFile(BaseModel):
    """A file of the phone page: how large it is, and how large when it is sent compressed."""

    path: str
    sha256: str
    size_bytes: int
    sent_bytes: int


class PageList(BaseModel):
    """All of them; the version is another one whenever a file is."""

    version: str
    size_bytes: int
    sent_bytes: int
    files: list[PageFile]


class PagesMount(Mount):
    """Every path but those of the API, which answers for its own."""

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """As a mount at / does, the API left out."""
        if scope.get("path", "").startswith("/api"):
            return Match.NONE, {}
        return super().matches(scope)


def install_pages(app: FastAPI, settings: ServerSettings) -> None:
    """Serve the pages, some at short addresses, and what phones draw walks with beside them.

    That is the shipped encoder and the pipeline's parameters, which are written to the data folder.
    """
    folder = settings.pages_folder
    parameters = settings.data_folder / PARAMETERS
    parameters.write_text(json.dumps(phone_parameters(GROUPS_OF_WALK)), encoding="utf-8")
    for suffix, kind in TYPES.items():
        mimetypes.add_type(kind, suffix)
    files = PageFiles(
        folder, {f"stages/{PARAMETERS}": parameters, "stages/encoder.onnx": SHIPPED_ENCODER}
    )
    for address, name in PAGES.items():
        app.get(address, include_in_schema=False)(partial(files.page, name))
        app.head(address, include_in_schema=False)(partial(files.page, name))
    app.get("/precache.json", operation_id="list_page_files", tags=["server"])(files.page_files)
    app.get(f"/{WORKER}", include_in_schema=False)(files.worker)
    app.get(
        f"/{CERTIFICATE}",
        operation_id="get_authority",
        response_class=FileResponse,
        responses=problems(404),
        tags=["server"],
    )(authority)
    app.router.routes.append(PagesMount("/", app=files))


def authority(services: ServicesDep) -> FileResponse:
    """The certificate of this server's authority, to be installed on phones that ask for one."""
    file = services.settings.authority_folder / CERTIFICATE
    if not file.is_file():
        raise Problem(404, "this server speaks plain HTTP and has no certificate")
    return FileResponse(file, media_type="application/x-x509-ca-cert", filename="elfslam.pem")
