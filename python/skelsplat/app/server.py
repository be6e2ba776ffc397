"""The server of the page: on 127.0.0.1 alone, for one folder; and the files that go in and out."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import quote

import uvicorn
from fastapi import FastAPI, HTTPException, Request
from fastapi.responses import FileResponse, JSONResponse, Response, StreamingResponse
from nicegui import ui

from skelsplat._atomic import atomic_path
from skelsplat.app import pages
from skelsplat.app.guard import HOST, Guard
from skelsplat.app.places import Place
from skelsplat.app.recordings import Recordings
from skelsplat.cli.of_found import PAGE_OF_CAMERAS
from skelsplat.exceptions import SkelSplatError
from skelsplat.io._run_files import is_run
from skelsplat.run.files import files_of, zipped

# What is in a folder is from elsewhere: as a page of its own it may run programs, and not use this server.
_ALONE = {"content-security-policy": "sandbox allow-scripts allow-downloads; frame-ancestors 'self'"}


def serve(folder: Path, port: int, tell: Callable[[str, Path], object]) -> None:
    """Serve the page about a folder until Ctrl-C, and tell its address once it is open."""
    place = Place(folder.resolve())
    place.folder("")
    with socket.create_server((HOST, port)) as listener:
        recordings = Recordings(place)
        guard = Guard(_app(recordings), listener.getsockname()[1])
        tell(guard.address, place.root)
        settings = uvicorn.Config(guard, log_level="error", lifespan="on", timeout_graceful_shutdown=2)
        try:
            uvicorn.Server(settings).run(sockets=[listener])
        finally:
            recordings.cancel()


def _app(recordings: Recordings) -> FastAPI:
    """Return the application: pages, and files in and out."""
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    for kind in (SkelSplatError, OSError):
        app.add_exception_handler(kind, lambda _, error: JSONResponse({"detail": str(error)}, 400))
    _add_files(app, recordings.place)
    pages.add_pages(recordings)
    ui.run_with(app, title="SkelSplat", favicon="🦴", dark=None, language="en-US")
    return app


def _add_files(app: FastAPI, place: Place) -> None:
    """Add what the browser takes out of the folder of a run, and puts into the folder of a recording."""

    @app.get("/run/{path:path}")
    def take(path: str, folder: str = "", download: bool = False) -> Response:
        run = place.inside(folder)
        file = place.inside(path, run)
        if path != PAGE_OF_CAMERAS and not (is_run(run) and path in [name for name, *_ in files_of(run)]):
            raise HTTPException(404, "There is no such file of a run.")
        headers = _ALONE | {"cache-control": "no-store"}
        return FileResponse(file, filename=file.name if download else None, headers=headers)

    @app.get("/zip")
    def take_all(folder: str = "") -> Response:
        run = place.inside(folder)
        if not is_run(run):
            raise HTTPException(404, "There is no run in this folder.")
        name = quote(f"{run.parent.name if run.name == 'out' else run.name}.zip")
        headers = {"content-disposition": f"attachment; filename*=utf-8''{name}"}
        return StreamingResponse(zipped(run), media_type="application/zip", headers=headers)

    @app.put("/bring")
    async def bring(request: Request, folder: str = "", name: str = "") -> Any:
        file = place.file_to_write(place.inside(folder), name)
        if file.exists():
            raise HTTPException(409, f"{name} is there already; it was left as it is.")
        file.parent.mkdir(parents=True, exist_ok=True)
        with atomic_path(file) as part, part.open("wb") as stream:
            async for piece in request.stream():
                stream.write(piece)
        return {"name": name}
