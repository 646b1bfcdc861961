"""Addresses of the workbench, below the token. Each route calls one function and says its error in a sentence."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

import anyio.to_thread
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import Route

from rfea_vision.errors import RfeaError
from rfea_vision.files import storage_error
from rfea_vision.workbench.app_state import AppState, Asked
from rfea_vision.workbench.loading import loaded

#: Bytes of a question: a law of one's own has some thousand, the rest far less.
LARGEST_BODY = 1_000_000
KINDS = {".html": "text/html", ".css": "text/css", ".js": "text/javascript"}


def application(app: AppState) -> Starlette:
    """The server's routes."""

    def route(method: str, path: str, answer: str) -> Route:
        async def endpoint(request: Request) -> Response:
            given = await _body(request) if method == "POST" else dict(request.query_params)
            return await _behind(answer, app, request, given)

        return Route(path, endpoint, methods=[method])

    get, post = partial(route, "GET"), partial(route, "POST")
    return Starlette(
        routes=[
            Route("/", lambda request: RedirectResponse("c/0/" if app.single else "c/all/")),
            Route("/c/all/", lambda request: static("index.html")),
            Route("/c/{index:int}/", lambda request: static("index.html")),
            Route("/static/{name}", lambda request: static(request.path_params["name"])),
            Route("/report/{name}", lambda request: of_report(request.path_params["name"])),
            Route("/events", events(app)),
            get("/campaigns", "campaigns"),
            post("/stop", "stop"),
            post("/batch", "batch"),
            get("/c/{index:int}/state", "state"),
            get("/c/{index:int}/evidence", "evidence"),
            get("/c/{index:int}/clip/{number:int}", "clip"),
            get("/c/{index:int}/report", "report"),
            get("/c/{index:int}/effects", "effects"),
            post("/c/{index:int}/model", "model"),
            post("/c/{index:int}/play", "play"),
            post("/c/{index:int}/job", "job"),
            get("/c/{index:int}/film/{number:int}", "film"),
            get("/c/{index:int}/columns/{number:int}", "columns"),
            get("/c/{index:int}/picture/{number:int}", "picture"),
            get("/c/{index:int}/outline/{number:int}", "outline"),
            get("/c/{index:int}/refused/{number:int}", "refused"),
            get("/c/{index:int}/photo/{number:int}", "photo"),
            post("/c/{index:int}/hint/{number:int}", "hint"),
            post("/c/{index:int}/sync/{number:int}", "sync"),
            post("/c/{index:int}/law/template", "law_template"),
            post("/c/{index:int}/law/new", "law_new"),
            post("/c/{index:int}/law/open", "law_open"),
            post("/c/{index:int}/law/check", "law_check"),
            post("/c/{index:int}/curve", "curve"),
            post("/c/{index:int}/try/{number:int}", "trial"),
        ]
    )


async def _behind(answer: str, app: AppState, request: Request, given: dict[str, Any]) -> Response:
    """Answer in a thread; when the server ends, nobody waits for it."""
    index, number = (int(request.path_params.get(key, 0)) for key in ("index", "number"))
    if index >= len(app.campaigns):
        raise HTTPException(404)
    return await anyio.to_thread.run_sync(_said, answer, Asked(app, index, number, given), abandon_on_cancel=True)


async def _body(request: Request) -> dict[str, Any]:
    """The JSON object that was sent; a form or a plain text, which another page could send unasked, is refused."""
    if request.headers.get("content-type") != "application/json":
        raise HTTPException(415)
    data = b""
    async for part in request.stream():
        data += part
        if len(data) > LARGEST_BODY:
            raise HTTPException(413)
    try:
        content = json.loads(data)
    except ValueError as error:
        raise HTTPException(400) from error
    if not isinstance(content, dict):
        raise HTTPException(400)
    return content


def _said(answer: str, asked: Asked) -> Response:
    """The answer of that name, or why there is none; the libraries behind them are loaded when the first is asked for."""
    try:
        found = getattr(loaded("workbench.answers"), answer)(asked)
        return found if isinstance(found, Response) else JSONResponse(found)
    except RfeaError as error:
        return JSONResponse({"error": str(error)}, 422)
    except OSError as error:
        said = str(storage_error(error) or f"{error.filename}: {error.strerror}")
        return JSONResponse({"error": said}, 422)
    except (KeyError, TypeError, ValueError) as error:
        return JSONResponse({"error": f"the page asked for something that is not there ({error})"}, 400)


def static(name: str) -> Response:
    """A file of the page; HTTPException 404 if the page has no such file."""
    file = resources.files("rfea_vision.workbench").joinpath("static", name)
    kind = KINDS.get(Path(name).suffix)
    if kind is None or "/" in name or not file.is_file():
        raise HTTPException(404)
    return Response(file.read_bytes(), media_type=kind)


#: The report's scripts that the workbench draws with, in their order, and the names that its own modules take from them.
REPORT_SCRIPTS = ("data", "pen", "plot", "time", "where", "shape", "trust", "stage", "controls")
EXPORTED = (
    "manifest", "state", "on", "tell", "series", "show", "extent", "nearest", "takeBlock", "unpacked", "experiment", "rung",
    "prediction", "plots", "Figure", "scale", "padded", "axisX", "axisY", "area", "colours", "ticks", "timeBox", "timeScale",
    "cursorAt", "download", "stage", "paintStage", "seek", "play", "pose", "poseTime", "setTime", "setWindow", "zoom", "step",
    "chooseRung", "chooseExperiment", "holdEarlier", "showTime", "showMarks", "toggleScale", "toggleTheme", "setTheme", "jumpToPeak",
    "forgetView", "toError",
)  # fmt: skip


def of_report(name: str) -> Response:
    """The report's style sheet, and its scripts as one module; without the report itself. HTTPException 404 for others."""
    folder = resources.files("rfea_vision").joinpath("report", "static")
    if name == "style.css":
        return Response(folder.joinpath(name).read_bytes(), media_type="text/css")
    if name != "report.js":
        raise HTTPException(404)
    parts = [folder.joinpath(f"{script}.js").read_text(encoding="utf-8") for script in REPORT_SCRIPTS]
    return Response("\n".join([*parts, f"export {{{', '.join(EXPORTED)}}};"]), media_type="text/javascript")


def events(app: AppState) -> Callable[[Request], Awaitable[Response]]:
    """Server-sent events of everything that happens."""

    async def stream() -> AsyncIterator[str]:
        queue = app.listen()
        try:
            yield ": listening\n\n"
            while not app.ending():
                try:
                    event = await asyncio.wait_for(queue.get(), 0.5)
                except TimeoutError:
                    continue
                yield f"data: {json.dumps(event, default=str)}\n\n"
        finally:
            app.leave(queue)

    async def endpoint(request: Request) -> Response:
        return StreamingResponse(stream(), media_type="text/event-stream")

    return endpoint
