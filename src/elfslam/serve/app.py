"""The server as an app: routes, guards, pages, and what runs beside them."""

from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager, AsyncExitStack, asynccontextmanager
from dataclasses import asdict

from fastapi import APIRouter, Depends, FastAPI
from fastapi.exceptions import RequestValidationError
from fastapi.responses import FileResponse
from pydantic import BaseModel
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

from elfslam import __version__
from elfslam.serve import demonstration
from elfslam.serve.buildings import find as buildings
from elfslam.serve.jobs import routes as jobs
from elfslam.serve.jobs.runner import run_jobs
from elfslam.serve.maps import package, places
from elfslam.serve.maps import routes as maps
from elfslam.serve.page_routes import install_pages
from elfslam.serve.parsing.children import forks
from elfslam.serve.people import users
from elfslam.serve.people.access import current_user
from elfslam.serve.people.guards import Guard
from elfslam.serve.positions import routes as positions
from elfslam.serve.positions.mqtt import publishing
from elfslam.serve.positions.routes import keeping_history
from elfslam.serve.positions.webhooks import posting
from elfslam.serve.problems import EVERYWHERE, ProblemBody, install_problems
from elfslam.serve.receiving import recordings, uploads
from elfslam.serve.services import Services, ServicesDep
from elfslam.serve.sharing import routes as sharing
from elfslam.serve.sharing.rights import identify_first
from elfslam.serve.store.sweeps import sweeping
from elfslam.stages.chirp import ChirpParameters
from elfslam.stages.medium_access import MediumAccessParameters

ROUTERS: tuple[APIRouter, ...] = (
    users.router,
    recordings.router,
    uploads.router,
    jobs.router,
    positions.router,
    positions.map_router,
    sharing.group_router,
    demonstration.router,
)
"""Under /api, all of them for users with a token."""
ADMITTING: tuple[APIRouter, ...] = (
    buildings.router,
    maps.router,
    maps.plan_router,
    places.router,
    package.router,
    sharing.router,
)
"""Also under /api; each route looks itself at who asks: by token, or by the link of a map."""
BACKGROUND: tuple[Callable[[Services], AbstractContextManager[None]], ...] = (
    sweeping,
    run_jobs,
    keeping_history,
    publishing,
    posting,
)
"""Entered when the server starts and left when it stops."""
DESCRIPTION = """Walk with a phone, see the map. Every call under `/api` wants a pairing token, as
`Authorization: Bearer TOKEN` or as the cookie that `POST /api/session` sets, but those for the
version, for the signing key, for codes and links, and for the drawing script of reports. A map that
is shared by link opens also with the cookie that `POST /api/links/open` sets for it. Refusals are
`application/problem+json`; their `detail` is one line for people."""


class Version(BaseModel):
    """What this server is."""

    version: str
    chirp: dict[str, object]
    medium_access: dict[str, float]
    limits: dict[str, float]


public = APIRouter(tags=["server"])


@public.get("/version", operation_id="get_version")
def version(services: ServicesDep) -> Version:
    """The version, the chirp that phones should play and how they take turns, and the limits."""
    return Version(
        version=__version__,
        chirp=played(ChirpParameters()),
        medium_access=asdict(MediumAccessParameters()),
        limits=asdict(services.settings.limits),
    )


@public.get(
    "/maps/{map_id}/plotly-{version}.min.js",
    operation_id="get_drawing_script",
    response_class=FileResponse,
    responses={200: {"content": {"text/javascript": {}}}},
)
def drawing_script(map_id: str, version: str) -> FileResponse:
    """What draws the figures of a report: public, for the sandbox of a report sends no cookie."""
    from elfslam.app.show import script_file

    allowed = {"Cross-Origin-Resource-Policy": "cross-origin", "Cache-Control": "max-age=86400"}
    return FileResponse(script_file(), media_type="text/javascript", headers=allowed)


PUBLIC: tuple[APIRouter, ...] = (public, users.public, package.public, sharing.public)
"""Under /api, for anyone."""


def played(chirp: ChirpParameters) -> dict[str, object]:
    """The chirp as recording.json describes it."""
    told = asdict(chirp)
    band_hz = [told.pop("band_low_hz"), told.pop("band_high_hz")]
    return {**told, "band_hz": band_hz}


def create_app(services: Services) -> FastAPI:
    """The app of a data folder. Nothing else is shared between two apps."""
    app = FastAPI(
        title="elfslam",
        version=__version__,
        description=DESCRIPTION,
        docs_url=None,
        redoc_url=None,
        lifespan=_lifespan,
    )
    app.state.services = services
    for router in PUBLIC:
        app.include_router(router, prefix="/api")
    for router in ROUTERS:
        app.include_router(
            router, prefix="/api", dependencies=[Depends(current_user)], responses=EVERYWHERE
        )
    for router in ADMITTING:
        app.include_router(router, prefix="/api", responses=EVERYWHERE)
    install_problems(app)
    for unfit in (RequestValidationError, HTTPException):
        app.add_exception_handler(unfit, identify_first)
    install_pages(app, services.settings)
    _describe_problems(app)
    app.add_middleware(Guard, services=services)
    return app


@asynccontextmanager
async def _lifespan(app: FastAPI) -> AsyncIterator[None]:
    services: Services = app.state.services
    async with AsyncExitStack() as stack:
        stack.callback(services.engine.dispose)
        forks()
        for begin in BACKGROUND:
            running = begin(services)
            await run_in_threadpool(running.__enter__)
            stack.push_async_callback(run_in_threadpool, running.__exit__, None, None, None)
        yield


def _describe_problems(app: FastAPI) -> None:
    """Put the schema that refusals point to into the OpenAPI description."""
    describe = app.openapi

    def described() -> dict[str, object]:
        schema = describe()
        known = schema.setdefault("components", {}).setdefault("schemas", {})
        known.setdefault("ProblemBody", ProblemBody.model_json_schema())
        return schema

    app.openapi = described  # type: ignore[method-assign]
