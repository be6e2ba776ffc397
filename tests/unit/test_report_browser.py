"""report.html in headless Chromium, off line: it opens without an error, plays, and follows its controls."""

from __future__ import annotations

import io
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.image import imread

from people_page import people_report
from report_page import report_data, sequence
from rig_room import write_room
from skelsplat.run.calibrate import calibrate_cameras
from skelsplat.run.calibrate_page import page_of
from skelsplat.viz import _style, report

READY = "document.documentElement.dataset.ready === 'yes'"
PATIENCE_MS = 60_000


DRAWN = """
new Promise((done) => setTimeout(() => requestAnimationFrame(() => requestAnimationFrame(done)), 150))
"""
# As the page was when it was opened; opening one takes longest of all.
RESET = """
async (fragment) => {
  pause();
  for (const one of document.querySelectorAll("input[type=checkbox], input[type=radio]")) {
    if (one.checked === one.defaultChecked) continue;
    one.checked = one.defaultChecked;
    if (one.checked || one.type === "checkbox") one.dispatchEvent(new Event("change"));
  }
  for (const one of document.querySelectorAll("select")) {
    if (one.selectedIndex === 0) continue;
    one.selectedIndex = 0;
    one.dispatchEvent(new Event("change"));
  }
  await show(0);
  await setCamera(firstLook());
  scrollTo(0, 0);
  history.replaceState(null, "", location.pathname);
  if (fragment) location.hash = fragment;
  await %s  // until the view is drawn: a drag before that is lost
}
"""
RESET = RESET % DRAWN


NASTY = "<img src=x onerror=alert(1)></script>'é"
ESCAPED = NASTY.replace("<", "&lt;")  # in names of panels
STAMPS = 1_636_212_345_678 + 33 * np.arange(40)


def in_time():
    """Build a report of a solution over time: each frame alone has knees that jump up and down.

    With names that look like markup, and a wide error bar in the last frame.
    """
    walk = sequence(joint_names=(NASTY, "left_knee", "right_knee"), start_name=NASTY)
    wide = walk.error_bar.copy()
    wide[-1, 0] = np.diag([900.0, 20.0, 20.0]) ** 2
    jumps = np.zeros_like(walk.refined)
    jumps[::2, 1:, 2] = 60.0
    speed = np.full(walk.refined.shape[:2], 1500.0)
    speed[0, 0] = np.nan
    walk = replace(walk, alone=walk.refined + jumps, speed=speed, error_bar=wide)
    bones = [(0, 1, 474.0, 5.0), (0, 2, 474.0, np.nan), (1, 2, 300.0, 5.0)]
    nasty = {"names": (NASTY, "window"), "title": NASTY, "warnings": [NASTY]}
    return report_data(walk, bones=bones, **nasty)


@pytest.fixture(scope="module")
def opened(browser, tmp_path_factory):
    """Open the report of a function's data, once, and return its page and what it complains of."""
    pages = {}

    def open_page(make, fragment):
        if make in pages:
            pages[make][0].evaluate(RESET, fragment)
        else:
            pages[make] = _open(browser, tmp_path_factory.mktemp("page") / "report.html", make(), fragment)
        return pages[make]

    yield open_page
    for page, _ in pages.values():
        page.close()


def _open(browser, path, data, fragment):
    report.write_report(path, data)
    page, complaints = browser.new_page(viewport={"width": 800, "height": 700}), []
    page.set_default_timeout(PATIENCE_MS)
    page.context.set_offline(True)
    page.on("pageerror", lambda error: complaints.append(f"exception: {error}"))
    page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
    page.on("request", lambda asked: complaints.append(asked.url) if is_request(asked.url, path) else None)
    page.goto(path.as_uri() + fragment)
    wait(page, READY)
    return page, complaints


@pytest.fixture
def visit(opened):
    """Visit the page of a report; fail in the end if it complained or asked for anything else."""
    visited = []

    def open_page(make=in_time, fragment=""):
        page, complaints = opened(make, fragment)
        visited.append(complaints)
        page.mouse.move(0, 0)  # the view has buttons under it
        wait(page, "!player.busy && player.wanted === null")
        return page

    yield open_page
    assert [complaint for complaints in visited for complaint in complaints] == []


def wait(page, condition):
    """Wait until a condition holds; Playwright's own way to wait is forbidden by the page's policy."""
    for _ in range(PATIENCE_MS // 50):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(50)
    raise TimeoutError(condition)


def is_request(url, path):
    return url.partition("#")[0] != path.as_uri() and not url.startswith(("data:", "blob:"))


def frame_of(page):
    return int(page.input_value("#frame"))


def picture(page):
    """Return the 3D view (H, W, 3), once it has been still for a while."""
    wait(page, "!player.busy && player.wanted === null")
    page.evaluate(DRAWN)
    return imread(io.BytesIO(page.locator("#view canvas").first.screenshot()))[..., :3]


def near(image, colour, tolerance=0.12):
    """Return how many pixels are nearly of a colour."""
    wanted = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return int((np.abs(image - wanted).max(axis=-1) < tolerance).sum())


COLOURS = SimpleNamespace(left="#0072b2", right="#d55e00", start="#8c8c8c")


def test_play_goes_on_from_frame_to_frame_and_stops_at_the_end(visit):
    page = visit(fragment="#frame=120")
    assert frame_of(page) == 120
    page.click("#play")
    assert page.get_attribute("#play", "aria-label") == "Pause"
    wait(page, "Number(document.getElementById('frame').value) > 122")
    wait(page, "document.getElementById('frame').value === '139'")
    wait(page, "document.getElementById('play').getAttribute('aria-label') === 'Play'")
    assert page.evaluate("location.hash") == "#frame=139"


def test_the_pose_has_the_colours_of_its_sides_and_it_and_the_ellipsoids_can_be_chosen(visit):
    page = visit()
    refined = picture(page)
    # a limb is some 80 px long and 5 wide
    assert near(refined, COLOURS.left) > 100
    assert near(refined, COLOURS.right) > 100
    page.uncheck("#ellipsoids")
    bare = picture(page)
    assert np.abs(bare - refined).max() > 0.1
    page.check("#ellipsoids")
    # antialiasing may differ by single pixels
    assert (np.abs(picture(page) - refined) > 0.1).mean() < 0.001
    page.check("input[name=pose][value=start]")
    start = picture(page)
    assert np.abs(start - bare).max() > 0.1
    page.check("input[name=pose][value=both]")
    assert near(picture(page), COLOURS.start) > near(refined, COLOURS.start) + 50


def test_a_link_leads_to_its_frame(visit):
    page = visit(fragment="#frame=117")
    assert page.inner_text("h1") == NASTY  # names from files are shown as they are
    assert page.locator("img").count() == 0
    assert frame_of(page) == 117
    assert page.inner_text("#time") == "0.34 s"  # since the first frame, as in pose.trc and in the plots
    page.click("#problems a")
    wait(page, "document.getElementById('frame').value === '120'")
    assert page.inner_text("#reasons") == "weak: left_knee"
    assert page.evaluate("location.hash") == "#frame=120"
    page.evaluate("location.hash = '#frame=9999'")
    wait(page, "document.getElementById('frame').value === '139'")
    page.click("#previous")
    wait(page, "document.getElementById('frame').value === '120'")


def test_the_view_turns_follows_and_shows_all_cameras(visit):
    page = visit()
    eye = "Object.values(liveCamera().eye).map((value) => value.toFixed(6)).join()"
    page.locator("#view").scroll_into_view_if_needed()
    picture(page)
    box = page.locator("#view").bounding_box()
    seen = [page.evaluate(eye)]
    page.mouse.move(box["x"] + 300, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 420, box["y"] + 210, steps=4)
    page.mouse.up()
    wait(page, f"{eye} !== '{seen[-1]}'")
    picture(page)  # the last movement of the mouse is drawn
    seen.append(page.evaluate(eye))
    page.evaluate("show(39)")
    picture(page)
    assert page.evaluate(eye) == seen[-1]  # a new frame leaves the view as it is
    page.check("#follow")
    picture(page)
    seen.append(page.evaluate(eye))
    page.click("#fit-all")
    picture(page)
    seen.append(page.evaluate(eye))
    assert len(set(seen)) == 4


def curves(page, div):
    """Return the y values of the lines in an element, and the titles of its panels."""
    drawn = "trace.mode !== 'lines' || trace.line.width > 0"
    lines = page.evaluate(
        f"document.getElementById('{div}').data.filter((trace) => {drawn}).map(({{ y }}) => y)"
    )
    titles = page.evaluate(f"document.getElementById('{div}').layout.annotations.map(({{ text }}) => text)")
    return [np.array(line, dtype=float) for line in lines], titles


def test_bone_lengths_and_speeds_are_drawn_by_name_with_both_sides(visit):
    page = visit()
    lengths, titles = curves(page, "bones")
    assert titles == [f"{ESCAPED} – knee", "left knee – right knee"]
    assert len(lengths) == 6  # frame by frame and over time: left, right, and from one side to the other
    np.testing.assert_allclose(lengths[1], np.hypot(150.0, 450.0), atol=0.5)
    assert np.ptp(lengths[0]) > 40.0
    speeds, titles = curves(page, "speeds")
    assert titles == [ESCAPED, "knee"]
    assert np.isnan(speeds[0][0])
    np.testing.assert_allclose(speeds[1], 1.5, rtol=1e-4)


def test_the_trajectory_of_the_chosen_joint_has_its_band(visit):
    page = visit()
    page.select_option("#trajectory-joint", label="right knee")
    found, titles = curves(page, "trajectory")
    assert titles == ["x [mm]", "y [mm]", "z [mm]"]
    np.testing.assert_allclose(found[1], np.linspace(0.0, 3000.0, 40), atol=0.5)
    bands = "document.getElementById('trajectory').data.filter((trace) => trace.line.width === 0)"
    low, high, *_ = page.evaluate(f"{bands}.map(({{ y }}) => y[3])")
    assert high - low == pytest.approx(80.0, abs=0.5)  # ±2 standard deviations of 20 mm


def test_people_have_their_colours_and_names_in_the_view(visit):
    page = visit(people_report, "#frame=110")
    image = picture(page)
    for colour in _style.PEOPLE[:3]:
        assert near(image, colour) > 100
    assert near(image, _style.PEOPLE[3]) < 20
    assert page.evaluate("labels(scene.refined, 10).texts") == ["person 0", "person 1", "person 2"]
    assert page.evaluate("labels(scene.refined, 30).texts") == ["person 0", "person 1"]
    page.check("#ellipsoids")
    wait(page, "view.div.data[MOVING.indexOf('ellipsoids')].visible === true")


@pytest.fixture(scope="module")
def of_cameras(tmp_path_factory):
    """Return what makes the data of the page of a calibration in which a camera is left out."""
    room = write_room(tmp_path_factory.mktemp("room"), "other")
    given = {"layout": "h36m17", "fps": 25.0, "stature": 1.7}  # as in test_cli_calibrate.py: found once
    found = calibrate_cameras(room / "other", room / "lenses.toml", **given)
    return partial(page_of, found, ())


def test_the_page_of_a_calibration_shows_its_cameras(visit, of_cameras):
    page, cameras = visit(of_cameras), ("cam1", "cam2", "cam3")
    names = page.evaluate("view.div.data[MOVING.length + FIXED.indexOf('names')].text")
    assert names == list(cameras)
    corners = page.evaluate("placesOfCameras().x.length / SPHERE.corners.length")
    assert corners == len(cameras)
    shown = picture(page)
    page.uncheck("#places")
    assert np.abs(picture(page) - shown).max() > 0.1
    for hidden in ("#ellipsoids", "#problems", "#next", "input[value=start]"):
        assert not page.is_visible(hidden)
    page.check("input[name=heat][value='2']")
    cells = "heatMap.data[0].z[0]"
    wait(page, f"{cells}[1] > 1000")
    page.evaluate("show(50)")
    picture(page)


def test_a_bar_is_as_long_as_the_person_is_there(visit):
    page = visit(people_report)
    rows = page.evaluate("charts.lines.data.filter((trace) => trace.type === 'heatmap').map(({ z }) => z[0])")
    assert [sum(count is not None for count in row) for row in rows] == [40, 30, 20]
    assert page.evaluate("charts.lines.layout.yaxis3.ticktext") == ["person 0", "person 1", "person 2"]
    page.evaluate("charts.lines.emit('plotly_click', { points: [{ x: 117 }] })")
    wait(page, "document.getElementById('frame').value === '117'")


def test_within_a_page_it_scrolls_itself_alone(browser, tmp_path):
    """Frames have time stamps for numbers, each solved by itself."""
    report.write_report(tmp_path / "report.html", report_data(replace(sequence(), frames=STAMPS)))
    around = "<p style='height: 3000px'></p><iframe src='report.html' height=400 width=700></iframe>"
    (tmp_path / "around.html").write_text(around, encoding="utf-8")
    page = browser.new_page()
    page.goto((tmp_path / "around.html").as_uri())
    inner = page.frames[1]
    inner.wait_for_function(READY, timeout=PATIENCE_MS)
    assert inner.evaluate("scrollY") > 0
    inner.evaluate(f"location.hash = '#frame={STAMPS[7]}'")
    inner.wait_for_function(f"document.getElementById('frame').value === '{STAMPS[7]}'")
    assert page.evaluate("scrollY") == 0
    assert inner.locator("#bones").count() == 0
    page.close()
