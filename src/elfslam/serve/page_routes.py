"""The pages of the phone and the desk, and the certificate that makes browsers trust us."""

from __future__ import annotations

import json
import mimetypes
from collections.abc import Awaitable, Callable
from pathlib import Path

from fastapi import FastAPI, Request
from fastapi.responses import FileResponse, Response
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.routing import Match, Mount
from starlette.types import Scope

from elfslam.serve.maps.package import GROUPS_OF_WALK, phone_parameters
from elfslam.serve.problems import Problem, problems
from elfslam.serve.services import ServicesDep
from elfslam.serve.settings import ServerSettings
from elfslam.serve.static_files import PageFiles
from elfslam.stages.feature import SHIPPED_ENCODER

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
        app.get(address, include_in_schema=False)(_page(files, name))
        app.head(address, include_in_schema=False)(_page(files, name))
    app.get("/precache.json", operation_id="list_page_files", tags=["server"])(_list(files))
    app.get(f"/{WORKER}", include_in_schema=False)(_worker(files, folder / WORKER))
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


def _page(files: PageFiles, name: str) -> Callable[[Request], Awaitable[Response]]:
    async def page(request: Request) -> Response:
        try:
            return await files.get_response(name, request.scope)
        except HTTPException as error:
            raise Problem(404, f"this installation has no {name}; install elfslam again") from error

    return page


def _list(files: PageFiles) -> Callable[[], PageList]:
    def page_files() -> PageList:
        """The files that the phone page keeps, so that it opens without a network."""
        return PageList(**files.kept_by_phones())

    return page_files


def _worker(files: PageFiles, file: Path) -> Callable[[], Response]:
    def worker() -> Response:
        """The service worker, another one whenever a file of the page is."""
        told = f'const VERSION = "{files.kept_by_phones()["version"]}";\n'
        return Response(told + file.read_text(encoding="utf-8"), media_type=TYPES[".js"])

    return worker
