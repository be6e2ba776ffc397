"""``skelsplat app`` in headless Chromium, as somebody uses it who has never seen a command line."""

from __future__ import annotations

import http.client
import os
import re
import signal
import socket
import subprocess
import sys
import time
import zipfile
from pathlib import Path
from types import SimpleNamespace
from urllib.request import Request, urlopen

import numpy as np
import pytest

import skelsplat as sk
from detector_of_dots import rtmlib
from skelsplat import synthetic
from skelsplat.io import read_pose, write_calibration

pytest.importorskip("nicegui")
PATIENCE_MS = 60_000
LISTENS = "window.socket && window.socket.connected"
NARROW = "document.scrollingElement.scrollWidth <= 390"


@pytest.fixture(scope="module")
def root(tmp_path_factory, walk):
    """Give a folder with recordings: whole ones, one with a broken calibration, and an empty folder."""
    top = tmp_path_factory.mktemp("app") / "recordings"
    for name in ("walk", "second", "third", "broken"):
        (top / name).mkdir(parents=True)
        walk(top / name)
    (top / "broken" / "Calib.toml").write_text("[cam_0]\nmatrix = [[1, 2", encoding="utf-8")
    (top / "empty").mkdir()
    (top.parent / "outside.txt").write_text("a secret", encoding="utf-8")
    (top / "way-out").symlink_to(top.parent, target_is_directory=True)
    return top


def film(folder):
    """Write a walk as dots on videos of four cameras, with their calibration; return the pose (T, 17, 3)."""
    cv2 = pytest.importorskip("cv2")
    rig, pose = synthetic.human36m_like(distortion=False), synthetic.motion("walk", 6, seed=3)
    (folder / "videos").mkdir(parents=True)
    write_calibration(folder / "Calib.toml", rig)
    for name, camera, pixels in zip(rig.names, rig, np.rint(sk.project(pose, rig)).astype(int), strict=True):
        video = cv2.VideoWriter(
            str(folder / f"videos/{name}.avi"), cv2.VideoWriter_fourcc(*"FFV1"), 25.0, camera.size
        )
        for joints in pixels:
            image = np.zeros((*camera.size[::-1], 3), np.uint8)
            for dot, place in enumerate(joints):
                cv2.circle(image, place.tolist(), 2, (rtmlib.grey(dot),) * 3, -1)
            video.write(image)
        video.release()
    return pose


@pytest.fixture(scope="module")
def server(root):
    """Start the command with a detector of dots, and give its address and port."""
    program = "import sys; sys.argv[0] = 'skelsplat'; from skelsplat.cli import main; main()"
    command = [sys.executable, "-c", program, "app", str(root), "--no-browser"]
    paths = os.pathsep.join([str(Path(rtmlib.__file__).parents[1]), *filter(None, sys.path)])
    given = {
        "text": True,
        "cwd": root.parent,
        "env": {**os.environ, "PYTHONPATH": paths, "DOTS": str(root.parent)},
    }
    with subprocess.Popen(command, stdout=subprocess.PIPE, **given) as process:
        address = re.search(r"http://127\.0\.0\.1:(\d+)/\?key=(\S+)", process.stdout.readline())
        port, key = int(address[1]), address[2]
        yield SimpleNamespace(address=address[0], port=port, cookie=f"skelsplat-{port}={key}")
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=30)


@pytest.fixture(scope="module")
def context(browser, server):
    """Open the printed address once: its key becomes the cookie of all tabs."""
    opened = browser.new_context()
    opened.set_default_timeout(PATIENCE_MS)
    page = opened.new_page()
    page.goto(server.address)
    assert page.url == f"http://127.0.0.1:{server.port}/"
    (cookie,) = opened.cookies()
    assert (cookie["httpOnly"], cookie["sameSite"]) == (True, "Strict")
    page.close()
    return opened


@pytest.fixture(scope="module")
def tabs():
    """Keep the tabs that a test has left: opening one takes longest."""
    return []


@pytest.fixture
def visit(context, server, tabs):
    """Open pages in tabs; fail in the end if one complained, or asked another site for anything."""
    own = re.compile(rf"(http|ws)://127\.0\.0\.1:{server.port}/|data:|blob:")
    complaints, pages = [], []

    def open_page(path="/"):
        page = tabs.pop() if tabs else context.new_page()
        pages.append(page)
        page.set_viewport_size({"width": 1000, "height": 800})
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda asked: own.match(asked.url) or complaints.append(asked.url))
        page.goto(f"http://127.0.0.1:{server.port}{path}")
        page.wait_for_function(LISTENS)
        page.get_by_text("Looking at the folder").wait_for(state="detached")
        return page

    yield open_page
    tabs.extend(pages)
    assert complaints == []


def enter(page):
    """Follow the link that has the keyboard to the page of a recording, until it listens."""
    page.keyboard.press("Enter")
    page.get_by_role("heading", name="2 · Pose in 3D").wait_for()
    page.wait_for_function(LISTENS)


def press(page, name):
    page.get_by_role("button", name=name, exact=True).click()


def type_enter(page, name):
    page.get_by_role("button", name=name, exact=True).focus()
    page.keyboard.press("Enter")


def settle(page, press=press):
    """Answer what the files do not state."""
    press(page, "h36m17")
    page.get_by_text("Choose the layout").wait_for(state="detached")
    press(page, "50 per second")
    page.get_by_text("frame rate is not known").wait_for(state="detached")


def start_and_cancel_without_a_mouse(page):
    """Find the walk, answer what it lacks, start, and cancel."""
    page.get_by_role("link", name="walk", exact=True).focus()
    enter(page)
    settle(page, type_enter)
    for _ in range(60):
        page.keyboard.press("Tab")
        if "Find the pose" in page.evaluate("document.activeElement.innerText || ''"):
            break
    page.keyboard.press("Enter")
    page.get_by_role("progressbar").wait_for()
    page.wait_for_function("document.activeElement.innerText === 'Cancel'")
    page.keyboard.press("Enter")
    page.get_by_text("Cancelled").wait_for()
    page.wait_for_function("document.activeElement.innerText === 'Find the pose'")


def take_everything(page, root):
    """Take a file, and all in one; return the poses."""
    with page.expect_download() as taken:
        page.get_by_role("link", name="pose.trc").click()
    assert len(read_pose(taken.value.path().rename(root / "taken.trc")).frames) == 6
    with page.expect_download() as taken:
        press(page, "Everything in one zip file")
    with zipfile.ZipFile(taken.value.path()) as packed:
        assert packed.testzip() is None
        assert {"pose.trc", "report.json", "report.html"} <= {*packed.namelist()}
        packed.extract("pose.npz", root)
    return read_pose(root / "pose.npz").pose


def test_from_videos_to_files_interrupted_and_again_while_another_recording_is_cancelled(visit, root):
    pose, seen = film(root / "filmed"), root.parent / "seen"
    page = visit("/recording?at=filmed")
    press(page, "Find people in the videos")
    page.get_by_text(re.compile(r": \d+ of 24 frames")).wait_for()  # of all cameras
    start_and_cancel_without_a_mouse(visit())  # at the same time
    assert not (root / "walk/out").exists()
    while not seen.exists() or seen.stat().st_size < rtmlib.STOP_AT:
        time.sleep(0.05)
    press(page, "Cancel")
    page.get_by_text("Cancelled").wait_for()
    (root.parent / "go").touch()
    page.get_by_text("People were found in a part of the frames only").wait_for()
    press(page, "Find people in the videos")
    page.get_by_text("People were found in a part").wait_for(state="detached")
    assert seen.stat().st_size == 24 + 1  # nothing is done again, but for the image at the interruption
    press(page, "Find the pose")
    page.get_by_role("heading", name="3 · Result").wait_for()
    assert "skelsplat refine Calib.toml pose -o out" in page.inner_text("main")
    assert "Job('Calib.toml', 'pose'" in page.inner_text("main")
    assert np.abs(take_everything(page, root) - pose[:, rtmlib.DOTS]).max() < 30.0  # mm
    assert page.frame_locator("iframe").locator("#view").count() == 1
    assert not page.get_by_role("button", name="Draw it on the videos").is_disabled()
    page.evaluate("document.querySelector('iframe').was = 1")
    page.get_by_label("Frame rate").first.fill("50")
    page.get_by_text("--fps 50").first.wait_for()
    assert page.evaluate("document.querySelector('iframe').was") == 1  # it keeps its place
    press(page, "bvh")
    page.get_by_role("link", name="pose.bvh").wait_for()
    assert (root / "filmed/out/pose.bvh").is_file()
    assert (root / "filmed/out/pose.trc").is_file()


def test_what_is_wrong_is_said_in_one_line_with_what_to_do(visit):
    page = visit("/recording?at=broken")
    assert page.get_by_text("Calib.toml: ").count() >= 1
    assert page.get_by_role("button", name="Find the cameras from the people").is_visible()
    assert page.get_by_role("button", name="Find the pose").is_disabled()
    page = visit("/recording?at=third")
    settle(page)
    page.get_by_label("Frame rate").first.fill("-3")
    page.get_by_role("alert").get_by_text("Expected a positive number, got -3.").wait_for()
    assert page.get_by_role("button", name="Find the pose").is_disabled()
    page.get_by_label("Frame rate").first.fill("50")
    page.get_by_text("--fps 50").first.wait_for()


def test_a_narrow_screen_scrolls_only_down(visit):
    page = visit()
    page.set_viewport_size({"width": 390, "height": 800})
    assert page.evaluate(NARROW)
    page.goto(page.url + "recording?at=second")
    page.get_by_text("More settings").click()
    page.get_by_label("Min confidence").wait_for()
    assert page.evaluate(NARROW)


def test_files_are_brought_into_an_empty_folder(visit, root):
    page = visit("/recording?at=empty")
    page.get_by_text("no videos and no keypoints").wait_for()
    page.locator("input[type=file]").first.set_input_files(root / "walk/Calib.toml")
    page.get_by_text("Calib.toml", exact=True).wait_for()
    assert page.get_by_text("1 file is in the folder.").is_visible()
    assert (root / "empty/Calib.toml").read_bytes() == (root / "walk/Calib.toml").read_bytes()


def ask(server, method, path, **headers):
    """Ask the server as no browser would; return the status."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)
    given = {"Cookie": server.cookie, **headers}
    connection.request(method, path, body=b"x" if method == "PUT" else None, headers=given)
    answer = connection.getresponse()
    answer.read()
    connection.close()
    return answer.status


def test_a_page_is_there_before_its_recording_was_looked_at_and_loads_nothing_from_elsewhere(server):
    address = f"http://127.0.0.1:{server.port}/recording?at=walk"
    with urlopen(Request(address, headers={"Cookie": server.cookie}), timeout=30) as answer:
        assert "Looking at the folder" in answer.read().decode()
        assert "default-src 'self'" in answer.headers["content-security-policy"]
        assert answer.headers["referrer-policy"] == "no-referrer"


UPGRADE = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13"}
UPGRADE["Sec-WebSocket-Key"] = "dGhlIHNhbXBsZSBub25jZQ=="


@pytest.mark.parametrize("kind", ["page", "socket"])
@pytest.mark.parametrize(
    ("headers", "let_in"),
    [
        ({}, True),
        ({"Host": "localhost:{port}", "Origin": "http://127.0.0.1:{port}"}, True),
        ({"Cookie": ""}, False),
        ({"Cookie": "skelsplat-{port}=another"}, False),
        ({"Cookie": "skelsplat-1={key}"}, False),
        ({"Host": "evil.example:{port}"}, False),  # a name that leads here: DNS rebinding
        ({"Host": "127.0.0.1:80"}, False),
        ({"Origin": "http://evil.example"}, False),
        ({"Origin": "null"}, False),  # of a sandboxed page, as those of a run are
        ({"Origin": "http://127.0.0.1:1"}, False),
    ],
)
def test_only_the_browser_with_the_key_and_our_own_page_are_let_in(server, kind, headers, let_in):
    key = server.cookie.partition("=")[2]
    given = {name: text.format(port=server.port, key=key) for name, text in headers.items()}
    path = "/" if kind == "page" else "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
    status = ask(server, "GET", path, **(UPGRADE if kind == "socket" else {}), **given)
    assert status == ({"page": 200, "socket": 101}[kind] if let_in else 403)


def test_the_key_opens_the_page_on_this_machine_alone(server):
    key = server.address.partition("/?")[2]
    assert ask(server, "GET", f"/?{key}", Cookie="") == 303
    assert ask(server, "GET", "/?key=wrong", Cookie="") == 403
    assert ask(server, "GET", f"/?{key}", Cookie="", Host="evil.example") == 403
    assert ask(server, "PUT", "/bring?name=x.csv", Origin="http://evil.example") == 403
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.2", server.port), timeout=5)


@pytest.mark.parametrize(
    "path",
    [
        "/run/outside.txt?folder=..",
        "/run/../outside.txt?folder=walk/out",
        "/run/..%2F..%2Foutside.txt?folder=walk/out",
        "/run/Calib.toml?folder=walk",
        "/zip?folder=..",
        *(f"/run/outside.txt?folder={path}" for path in ("way-out", "/", "a%00b", "~root")),
    ],
)
def test_nothing_else_is_handed_out(server, path):
    assert ask(server, "GET", path) in (400, 404)


@pytest.mark.parametrize(
    "name",
    [
        *("", "..", "..%2Fx.csv", "%2E%2E%2F%2E%2E%2Fx.csv", "a%2F..%2F..%2Fx", ".profile", "a%2F.ssh%2Fx"),
        *("C:%5Cx", "Calib.toml"),
    ],
)
def test_nothing_is_written_elsewhere_or_over_a_file(server, root, name):
    before = sorted(root.parent.rglob("*"))
    assert ask(server, "PUT", f"/bring?folder=walk&name={name}") in (400, 409)
    for folder in ("..", "way-out"):
        assert ask(server, "PUT", f"/bring?folder={folder}&name=x.csv") == 400
    assert sorted(root.parent.rglob("*")) == before
