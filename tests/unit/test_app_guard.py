"""Who may use the page of ``skelsplat app``: nobody without the key, and no page from elsewhere."""

from __future__ import annotations

import asyncio

import pytest

from skelsplat.app.guard import Guard

PORT, KEY = 8123, "a-key"
HERE = f"127.0.0.1:{PORT}"


async def _inner(scope, receive, send):
    del receive
    if scope["type"] == "websocket":
        await send({"type": "websocket.accept"})
        return
    await send({"type": "http.response.start", "status": 200, "headers": [(b"x-frame", b"own")]})
    await send({"type": "http.response.body", "body": b"inside"})


def ask(kind="http", path="/", query="", host=HERE, **headers):
    """Return the first message of the answer, its headers, and the body."""
    sent = []
    named = {"host": host, "cookie": f"other=1; skelsplat-{PORT}={KEY}", **headers}
    pairs = [(name.encode(), value.encode()) for name, value in named.items() if value is not None]
    scope = {"type": kind, "path": path, "query_string": query.encode(), "headers": pairs, "method": "GET"}

    async def receive():
        return {"type": "websocket.connect"}

    async def send(message):
        sent.append(message)

    asyncio.run(Guard(_inner, PORT, KEY)(scope, receive, send))
    found = {name.decode(): value.decode() for name, value in sent[0].get("headers", ())}
    return sent[0], found, sent[-1].get("body", b"")


def is_let_in(first):
    return first["type"] == "websocket.accept" or first.get("status") == 200


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    ("headers", "let_in"),
    [
        ({}, True),
        ({"host": f"localhost:{PORT}"}, True),
        ({"origin": f"http://{HERE}"}, True),
        ({"cookie": None}, False),
        ({"cookie": f"skelsplat-{PORT}=another"}, False),
        ({"cookie": f"skelsplat-{PORT + 1}={KEY}"}, False),
        ({"host": f"evil.example:{PORT}"}, False),  # a name that leads here: DNS rebinding
        ({"host": "127.0.0.1:80"}, False),
        ({"host": None}, False),
        ({"origin": "http://evil.example"}, False),
        ({"origin": "null"}, False),  # of a sandboxed page, as those of a run are
        ({"origin": f"http://127.0.0.1:{PORT + 1}"}, False),
    ],
)
def test_only_the_browser_with_the_key_and_our_own_page_are_let_in(kind, headers, let_in):
    first, *_ = ask(kind, **headers)
    assert is_let_in(first) == let_in
    assert let_in or first.get("status") == 403 or first["type"] == "websocket.close"


def test_the_key_in_the_address_becomes_a_cookie_that_no_other_site_sends():
    first, headers, _ = ask(query=f"key={KEY}", cookie=None)
    assert (first["status"], headers["location"]) == (303, "/")
    assert headers["set-cookie"] == f"skelsplat-{PORT}={KEY}; Path=/; HttpOnly; SameSite=Strict"
    assert ask(query="key=wrong", cookie=None)[0]["status"] == 403
    assert ask(query=f"key={KEY}", cookie=None, host="evil.example")[0]["status"] == 403


def test_a_page_may_load_nothing_from_elsewhere_and_keeps_its_own_headers():
    _, headers, body = ask()
    assert body == b"inside"
    assert headers["x-frame"] == "own"
    assert "default-src 'self'" in headers["content-security-policy"]
    assert headers["referrer-policy"] == "no-referrer"
