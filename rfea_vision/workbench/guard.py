"""Who may speak to the workbench: this machine's user, by the token in the page's address, and no page from elsewhere."""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

Scope = MutableMapping[str, Any]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[..., Awaitable[None]]

#: Nothing from outside, no inline script or style, no frame around the page. `blob:` and `data:` are pictures and films
#: that the page's own scripts make.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; media-src 'self' blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",  # the address carries the token
    "cross-origin-resource-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cache-control": "no-store",
}


class Guard:
    """Refuses with 403 whatever does not come from the page that was opened, before anything else is looked at.

    The token stands first in the path, so that relative addresses carry it and no cookie is needed (cookies are shared by
    all ports of a host). A wrong ``Host`` is a name that somebody made point here (DNS rebinding); a wrong ``Origin`` or
    ``Sec-Fetch-Site`` is another page.
    """

    def __init__(self, app: App, token: str, port: int) -> None:
        self.app = app
        self.token = token
        self.hosts = {f"127.0.0.1:{port}", f"localhost:{port}"}

    async def __call__(self, scope: Scope, receive: Any, send: Send) -> None:
        """Serve one request, or refuse it."""
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self.app(scope, receive, send)
            return
        inner = self._inner_path(scope)

        async def dressed(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                own = dict(message.get("headers", []))  # a report brings a stricter policy of its own
                extra = {key.encode(): value.encode() for key, value in HEADERS.items()}
                message = {**message, "headers": [*(extra | own).items()]}
            await send(message)

        if inner is None:
            await dressed({"type": "http.response.start", "status": 403, "headers": [(b"content-type", b"text/plain")]})
            await dressed(
                {"type": "http.response.body", "body": b"not for you: use the address that rfea open printed\n"}
            )
            return
        await self.app({**scope, "path": inner, "raw_path": inner.encode(), "root_path": ""}, receive, dressed)

    def _inner_path(self, scope: Scope) -> str | None:
        """The path behind the token; None where the request is to be refused."""
        headers = {key.decode("latin-1").lower(): value.decode("latin-1") for key, value in scope["headers"]}
        origin = headers.get("origin")
        same = headers.get("sec-fetch-site", "none") in ("same-origin", "none")
        if headers.get("host") not in self.hosts or not same:
            return None
        if origin is not None and origin not in {f"http://{host}" for host in self.hosts}:
            return None
        first, _, rest = scope["path"].removeprefix("/").partition("/")
        return "/" + rest if secrets.compare_digest(first.encode(), self.token.encode()) else None
