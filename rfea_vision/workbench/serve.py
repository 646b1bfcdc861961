"""Starting and stopping the server; heavy libraries are loaded behind the page's back."""

from __future__ import annotations

import secrets
import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import uvicorn

from rfea_vision.errors import RfeaError
from rfea_vision.workbench.app_state import AppState
from rfea_vision.workbench.guard import Guard
from rfea_vision.workbench.loading import loaded
from rfea_vision.workbench.routes import application

TOKEN_BYTES = 24  # 192 bits: cannot be tried out


def serve(folder: Path, *, out: Path | None = None, port: int = 0, ready: Callable[[str], None]) -> None:
    """Serve the workbench of a campaign, or of a folder of campaigns, until interrupted.

    Parameters
    ----------
    folder : campaign, lone experiment, or a folder that holds campaigns
    out : where results go; default ``<campaign>/rfea``
    port : of 127.0.0.1; 0 takes a free one
    ready : called with the page's address once it answers

    Raises
    ------
    InputError
        If there is no campaign.
    OSError
        If the port is taken.
    """
    with socket.create_server(("127.0.0.1", port)) as listening:
        port = listening.getsockname()[1]
        token = secrets.token_urlsafe(TOKEN_BYTES)
        app = AppState(folder, out)
        config = uvicorn.Config(
            Guard(application(app), token, port), log_level="critical", lifespan="off", timeout_graceful_shutdown=1,
            http="h11", ws="none", access_log=False, server_header=False,
        )  # fmt: skip
        server = uvicorn.Server(config)
        app.ending = lambda: server.should_exit
        announce = threading.Thread(target=_announce, args=(server, app, ready, f"http://127.0.0.1:{port}/{token}/"))
        announce.daemon = True
        announce.start()
        try:
            server.run(sockets=[listening])
        finally:
            app.close()


def _announce(server: uvicorn.Server, app: AppState, ready: Callable[[str], None], address: str) -> None:
    """Say the address once the server answers; then load what the first page needs, and after it what the first click needs."""
    while not server.started and not server.should_exit:
        threading.Event().wait(0.01)
    if server.started:
        ready(address)
        loaded("workbench.answers")  # while the browser opens
        soon = ["play", "pointing"]
        if app.single:
            with suppress(RfeaError, OSError):  # said to the page when it asks
                if not app.opened(0).evidence()[0].steps:  # nothing to play yet: one looks at the films
                    soon.reverse()
        app.seen.wait()  # before the first page nothing is loaded that it does not show
        for name in soon:
            loaded(f"workbench.{name}")
        app.worker.warm()
