"""The pages of the phone and the desk, and the certificate that makes browsers trust us."""

from __future__ import annotations

import mimetypes
from collections.abc import Callable
from pathlib import Path

from fastapi import FastAPI
from fastapi.responses import FileResponse
from starlette.routing import Match, Mount
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

from elfslam.serve.problems import Problem, problems
from elfslam.serve.services import Here

PAGES = {"/": "phone.html", "/desk": "desk.html"}
CERTIFICATE = "authority.pem"
TYPES = {
    ".js": "text/javascript",
    ".mjs": "text/javascript",
    ".wasm": "application/wasm",
    ".webmanifest": "application/manifest+json",
    ".onnx": "application/octet-stream",
    ".phyphox": "application/octet-stream",
}


class PagesMount(Mount):
    """Every path but those of the API, which answers for its own."""

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """As a mount at / does, the API left out."""
        if scope.get("path", "").startswith("/api"):
            return Match.NONE, {}
        return super().matches(scope)


def install_pages(app: FastAPI, folder: Path) -> None:
    """Serve the files of a folder; two of them have short addresses."""
    for suffix, kind in TYPES.items():
        mimetypes.add_type(kind, suffix)
    for address, name in PAGES.items():
        app.get(address, include_in_schema=False)(_page(folder / name))
    app.get(
        f"/{CERTIFICATE}",
        operation_id="get_authority",
        response_class=FileResponse,
        responses=problems(404),
        tags=["server"],
    )(authority)
    app.router.routes.append(PagesMount("/", app=StaticFiles(directory=folder, check_dir=False)))


def authority(services: Here) -> FileResponse:
    """The certificate of this server's authority, to be installed on phones that ask for one."""
    file = services.settings.authority_folder / CERTIFICATE
    if not file.is_file():
        raise Problem(404, "this server speaks plain HTTP and has no certificate")
    return FileResponse(file, media_type="application/x-x509-ca-cert", filename="elfslam.pem")


def _page(file: Path) -> Callable[[], FileResponse]:
    def page() -> FileResponse:
        if not file.is_file():
            raise Problem(404, f"this installation has no {file.name}; install elfslam again")
        return FileResponse(file, media_type="text/html; charset=utf-8")

    return page
