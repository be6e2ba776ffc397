"""Who may use the page: the browser that opened the address with the key, and no page of another site.

The server listens on 127.0.0.1. That alone keeps out neither other people on the machine nor pages of other
sites that the browser has open: these can send requests to it, also under a name of their own that leads to
127.0.0.1 (DNS rebinding), and WebSockets follow no same-origin rule.
"""

from __future__ import annotations

import secrets

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

HOST = "127.0.0.1"
_OPEN = (
    "Open the address that skelsplat app has printed: the key in it is missing here, or of an earlier start."
)
# No other site is asked for anything, whatever a page contains; Vue compiles its templates.
_POLICY = (
    "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; connect-src 'self'; form-action 'self'; base-uri 'self'; "
    "frame-ancestors 'self'"
)
_HEADERS = {
    "content-security-policy": _POLICY,
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "cross-origin-resource-policy": "same-origin",
}


class Guard:
    """ASGI middleware that refuses requests and WebSockets without the key, or from elsewhere."""

    def __init__(self, app: ASGIApp, port: int, key: str | None = None) -> None:
        self.app, self.port = app, port
        self.key = key or secrets.token_urlsafe(24)
        self.cookie = f"skelsplat-{port}"  # cookies of all ports are one jar
        self.hosts = {f"{name}:{port}" for name in (HOST, "localhost")}

    @property
    def address(self) -> str:
        """The address that opens the page."""
        return f"http://{HOST}:{self.port}/?key={self.key}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what may pass."""
        if scope["type"] not in ("http", "websocket"):
            await self.app(scope, receive, send)
            return
        asked, is_page = HTTPConnection(scope), scope["type"] == "http"
        if not self._from_here(asked.headers):
            await self._refuse("This page is only for this machine.", scope, receive, send)
        elif is_page and scope["path"] == "/" and self._is_key(asked.query_params.get("key", "")):
            # the key becomes a cookie, so that it is in no history and no link
            cookie = f"{self.cookie}={self.key}; Path=/; HttpOnly; SameSite=Strict"
            headers = {**_HEADERS, "location": "/", "set-cookie": cookie}
            await Response(status_code=303, headers=headers)(scope, receive, send)
        elif not self._is_key(asked.cookies.get(self.cookie, "")):
            await self._refuse(_OPEN, scope, receive, send)
        else:
            await self.app(scope, receive, _with_headers(send))

    def _from_here(self, headers: Headers) -> bool:
        """Whether the host is this machine by number or name, and the page that asks is ours."""
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        ours = {f"http://{host}" for host in self.hosts}
        return len(hosts) == 1 and hosts[0] in self.hosts and all(origin in ours for origin in origins)

    def _is_key(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(), self.key.encode())

    async def _refuse(self, words: str, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            await PlainTextResponse(words, 403, _HEADERS)(scope, receive, send)
        else:
            await receive()
            await send({"type": "websocket.close", "code": 1008})


def _with_headers(send: Send) -> Send:
    """Return a function that adds the headers of all pages to those that a page does not have."""

    async def wrapped(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            for name, value in _HEADERS.items():
                headers.setdefault(name, value)
        await send(message)

    return wrapped
