"""The picture of ``calibrate --report``: ``python docs/figures/cameras.py [FOLDER]``; it needs Chromium.

The 3D view of the page, by the recording in the package.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

from skelsplat.io import sample

OPTIONS = "--layout body25b --size 1088x1920 --same-cameras --stature 1.7 --report cameras.html"
FLAGS = "--no-sandbox --disable-gpu --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader"
SIZE = {"width": 960, "height": 720}
COLOURS = 64


def main(folder: Path) -> None:
    with tempfile.TemporaryDirectory() as made:
        pose = sample.extract(made).detections.name
        command = [sys.executable, "-m", "skelsplat", "calibrate", pose, "-o", "found.toml"]
        subprocess.run([*command, *OPTIONS.split(), "--quiet"], check=True, cwd=made)
        picture = Image.open(io.BytesIO(_screenshot(Path(made) / "cameras.html"))).convert("RGB")
    picture.quantize(COLOURS).save(folder / "cameras.png", optimize=True)


def _screenshot(page: Path) -> bytes:
    """Return the 3D view as Chromium shows it."""
    with sync_playwright() as running:
        browser = running.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS.split())
        tab = browser.new_page(viewport=SIZE)
        tab.goto(page.as_uri())
        while not tab.evaluate("document.documentElement.dataset.ready === 'yes'"):
            tab.wait_for_timeout(50)
        tab.wait_for_timeout(1000)
        return tab.locator("#view").screenshot()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
