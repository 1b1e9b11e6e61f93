"""Errors as problem+json (RFC 9457): one line for people in `detail`."""

import logging
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, ValidationError
from sqlalchemy.exc import DatabaseError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from starlette.exceptions import HTTPException

from elfslam.base.errors import InputError, ParameterError, StoreError
from elfslam.serve.store.blobs import FULL_ERRORS

MEDIA_TYPE = "application/problem+json"
WRONG_CHECKSUM = 460
"""Of the tus protocol."""
LOCKED = ("database is locked", "lock timeout", "queuepool limit")
TITLES = {
    WRONG_CHECKSUM: "Checksum Mismatch",
    413: "Content Too Large",
    422: "Unprocessable Content",
}
LOG = logging.getLogger("elfslam.serve")


class Problem(HTTPException):
    """An answer that is a refusal: status, and one line that says what to do.

    `levels` are those of a plan, of which one is to be chosen.
    """

    def __init__(
        self,
        status: int,
        detail: str,
        headers: Mapping[str, str] | None = None,
        *,
        levels: Sequence[str] = (),
    ) -> None:
        super().__init__(status, detail, dict(headers or {}))
        self.levels = levels


class ProblemBody(BaseModel):
    """What a refusal looks like."""

    type: str = "about:blank"
    title: str
    status: int
    detail: str
    levels: list[str] | None = None


def title_of(status: int) -> str:
    """The standard words for a status."""
    return TITLES.get(status) or HTTPStatus(status).phrase


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """What a route declares that it may refuse with, for the OpenAPI description."""
    schema = {"schema": {"$ref": "#/components/schemas/ProblemBody"}}
    return {
        status: {"description": title_of(status), "content": {MEDIA_TYPE: schema}}
        for status in statuses
    }


EVERYWHERE = problems(400, 401, 403, 404, 408, 413, 421, 422, 429, 503, 507)
"""Any route under a token may refuse so."""


def problem_response(
    status: int, detail: str, headers: Mapping[str, str] | None = None, levels: Sequence[str] = ()
) -> JSONResponse:
    """A refusal as a response."""
    choice = list(levels) or None
    body = ProblemBody(title=title_of(status), status=status, detail=detail, levels=choice)
    told = body.model_dump(exclude_none=True)
    return JSONResponse(told, status, dict(headers or {}), MEDIA_TYPE)


def disk_full() -> Problem:
    """The refusal where nothing more fits."""
    return Problem(
        507,
        "the server's disk is full; what was acknowledged is kept, free some space and go on",
        {"Retry-After": "60"},
    )


def is_disk_full(error: BaseException) -> bool:
    """Whether an error says that nothing more fits, of the file system or of the database."""
    if isinstance(error, OSError):
        return error.errno in FULL_ERRORS
    text = str(error).lower()
    return isinstance(error, OperationalError) and (
        "disk is full" in text or "no space left" in text or "disk i/o error" in text
    )


def is_locked(error: BaseException) -> bool:
    """Whether an error says that somebody else holds what the database was to write."""
    text = str(error).lower()
    return any(words in text for words in LOCKED)


def install_problems(app: FastAPI) -> None:
    """Let every error of the app be answered as a problem."""
    app.add_exception_handler(HTTPException, of_http)
    app.add_exception_handler(RequestValidationError, of_validation)
    for kind in (InputError, ParameterError, StoreError):
        app.add_exception_handler(kind, _of_input)
    app.add_exception_handler(OSError, _of_disk)
    for away in (OperationalError, PoolTimeout):
        app.add_exception_handler(away, _of_database)
    for damage in (DatabaseError, ValidationError):
        app.add_exception_handler(damage, _of_damage)
    app.add_exception_handler(Exception, _of_bug)


async def of_http(_request: Request, error: Exception) -> JSONResponse:
    """The answer to what was refused."""
    assert isinstance(error, HTTPException)
    levels = error.levels if isinstance(error, Problem) else ()
    return problem_response(error.status_code, str(error.detail), error.headers, levels)


async def of_validation(_request: Request, error: Exception) -> JSONResponse:
    """The answer to what does not fit the description of its route."""
    assert isinstance(error, RequestValidationError)
    first = error.errors()[0]
    where = ".".join(str(part) for part in first["loc"])
    status = 400 if first["type"] == "json_invalid" else 422
    return problem_response(
        status, f"{where}: {first['msg']}; see /openapi.json for what is wanted"
    )


async def _of_input(_request: Request, error: Exception) -> JSONResponse:
    return problem_response(422, str(error))


async def _of_disk(request: Request, error: Exception) -> JSONResponse:
    if is_disk_full(error):
        full = disk_full()
        return problem_response(full.status_code, full.detail, full.headers)
    return await _of_bug(request, error)


async def _of_database(request: Request, error: Exception) -> JSONResponse:
    if is_disk_full(error):
        return await _of_disk(request, error)
    if is_locked(error):
        LOG.error("%s %s: the database is locked", request.method, request.url.path)
        return problem_response(
            503,
            "another program, or a long line of requests, holds the database; try again",
            {"Retry-After": "5"},
        )
    LOG.error("%s %s: the database", request.method, request.url.path, exc_info=error)
    return problem_response(503, "the database does not answer; try again", {"Retry-After": "5"})


async def _of_damage(request: Request, error: Exception) -> JSONResponse:
    """SQLite's file is no database any more, or a row holds what no answer may say.

    Whatever else is wrong with a statement is a bug.
    """
    if isinstance(error, DatabaseError) and type(error) is not DatabaseError:
        return await _of_bug(request, error)
    LOG.error("%s %s: the database is damaged", request.method, request.url.path, exc_info=error)
    return problem_response(503, "the database is damaged; restore it from a backup")


async def _of_bug(request: Request, error: Exception) -> JSONResponse:
    LOG.error("%s %s failed", request.method, request.url.path, exc_info=error)
    return problem_response(500, "the server made a mistake; its log says which")
