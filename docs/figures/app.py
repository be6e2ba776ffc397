"""The pictures of ``skelsplat app``: ``python docs/figures/app.py [FOLDER]``; it needs Chromium.

The page with the recording that the package includes: before anything is set, and with the result.
"""

from __future__ import annotations

import io
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from skelsplat.io import sample

FLAGS = "--no-sandbox --disable-gpu --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader"
SIZE = {"width": 1040, "height": 860}
COLOURS = 96
SETTINGS = "--unit m --layout body25b --fps 60"


def main(folder: Path) -> None:
    with tempfile.TemporaryDirectory() as made:
        root = Path(made) / "recordings"
        for name in ("balance", "balance-again"):
            pose = sample.extract(root / name).detections
        program = [sys.executable, "-m", "skelsplat"]
        refine = [*program, "refine", "Calib.toml", pose.name, "-o", "out", *SETTINGS.split(), "--quiet"]
        subprocess.run(refine, check=True, cwd=root / "balance")
        draw = [*program, "overlay", "out", "--plain", "--quiet"]
        subprocess.run(draw, check=True, cwd=root / "balance")
        with subprocess.Popen([*program, "app", str(root), "--no-browser"], stdout=subprocess.PIPE) as server:
            assert server.stdout is not None
            address = re.search(rb"http\S+", server.stdout.readline())
            assert address is not None
            _photograph(address[0].decode(), folder)
            server.send_signal(signal.SIGINT)


def _photograph(address: str, folder: Path) -> None:
    with sync_playwright() as running:
        browser = running.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS.split())
        tab = browser.new_page(viewport=SIZE)
        tab.goto(address)
        home = tab.url
        tab.goto(f"{home}recording?at=balance-again")
        tab.get_by_role("heading", name="1 · Recording").wait_for()
        _save(tab, folder / "app-recording.png")
        tab.goto(f"{home}recording?at=balance")
        heading = tab.get_by_role("heading", name="3 · Result")
        tab.frame_locator("iframe").locator("html[data-ready=yes]").wait_for()
        heading.evaluate("head => scrollTo(0, head.getBoundingClientRect().top + scrollY - 32)")
        tab.wait_for_timeout(3000)
        _save(tab, folder / "app-result.png")


def _save(tab: Page, path: Path) -> None:
    picture = Image.open(io.BytesIO(tab.screenshot())).convert("RGB")
    picture.quantize(COLOURS).save(path, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
