"""Who may use the page: the browser that opened the address with the key, and no page of another site.

The server listens on 127.0.0.1. That alone keeps out neither other people on the machine nor pages of other
sites that the browser has open: these can send requests to it, also under a name of their own that leads to
127.0.0.1 (DNS rebinding), and WebSockets follow no same-origin rule.
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

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
    b"content-security-policy": _POLICY.encode(),
    b"referrer-policy": b"no-referrer",
    b"x-content-type-options": b"nosniff",
    b"cross-origin-resource-policy": b"same-origin",
}


class Guard:
    """ASGI middleware that refuses requests and WebSockets without the key, or from elsewhere."""

    def __init__(self, app: App, port: int, key: str | None = None) -> None:
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
        is_page = scope["type"] == "http"
        if not self._from_here(scope):
            await self._refuse(is_page, "This page is only for this machine.", receive, send)
        elif is_page and scope["path"] == "/" and self._is_key(_given_key(scope)):
            await self._enter(send)
        elif not self._is_key(_cookie(scope, self.cookie)):
            await self._refuse(is_page, _OPEN, receive, send)
        else:
            await self.app(scope, receive, _with_headers(send))

    def _from_here(self, scope: Scope) -> bool:
        """Whether the host is this machine by number or name, and the page that asks is ours."""
        hosts, origins = (_all(scope, name) for name in (b"host", b"origin"))
        ours = {f"http://{host}" for host in self.hosts}
        return len(hosts) == 1 and hosts[0] in self.hosts and all(origin in ours for origin in origins)

    def _is_key(self, text: str) -> bool:
        return secrets.compare_digest(text.encode(), self.key.encode())

    async def _enter(self, send: Send) -> None:
        """Turn the key in the address into a cookie, so that it is in no history and no link."""
        cookie = f"{self.cookie}={self.key}; Path=/; HttpOnly; SameSite=Strict"
        headers = {b"location": b"/", b"set-cookie": cookie.encode()}
        await _answer(send, 303, headers, "")

    async def _refuse(self, is_page: bool, words: str, receive: Receive, send: Send) -> None:
        if is_page:
            await _answer(send, 403, {b"content-type": b"text/plain; charset=utf-8"}, words)
        else:
            await receive()
            await send({"type": "websocket.close", "code": 1008})


async def _answer(send: Send, status: int, headers: dict[bytes, bytes], words: str) -> None:
    pairs = [*headers.items(), *_HEADERS.items()]
    await send({"type": "http.response.start", "status": status, "headers": pairs})
    await send({"type": "http.response.body", "body": words.encode()})


def _all(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key.lower() == name]


def _given_key(scope: Scope) -> str:
    return str(parse_qs(scope["query_string"].decode("latin-1")).get("key", [""])[0])


def _cookie(scope: Scope, name: str) -> str:
    pairs = (part.strip().partition("=") for text in _all(scope, b"cookie") for part in text.split(";"))
    return next((value for key, _, value in pairs if key == name), "")


def _with_headers(send: Send) -> Send:
    """Return a function that adds the headers of all pages to those that a page does not have."""

    async def wrapped(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            own = {key.lower() for key, _ in message["headers"]}
            added = [pair for pair in _HEADERS.items() if pair[0] not in own]
            message = {**message, "headers": [*message["headers"], *added]}
        await send(message)

    return wrapped
