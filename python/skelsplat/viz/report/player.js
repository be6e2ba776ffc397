// Play, scrub, and links to frames.
"use strict";

const ASSUMED_RATE = 30; // frames per second where the recording's rate is unknown
const get = (id) => document.getElementById(id);
const controls = { scrubber: get("scrubber"), play: get("play"), frame: get("frame"), speed: get("speed"), marks: get("marks") };
const rate = scene.frame_rate ?? ASSUMED_RATE;
const player = { playing: false, busy: false, wanted: null };

// Show the frame at place `t`; of frames that come while one is drawn the last counts.
async function show(t) {
  player.wanted = Math.max(0, Math.min(scene.count - 1, t));
  tellFrame(player.wanted);
  if (player.busy) return;
  player.busy = true;
  while (player.wanted !== null && !view.held) {
    const next = player.wanted;
    player.wanted = null;
    await drawFrame(next);
  }
  player.busy = false;
}

function tellFrame(t) {
  const number = scene.frames[t];
  view.at = t;
  controls.scrubber.value = t;
  controls.scrubber.setAttribute("aria-valuetext", `frame ${number}`);
  if (document.activeElement !== controls.frame) controls.frame.value = number;
  if (scene.frame_rate) get("time").textContent = `${((number - scene.frames[0]) / rate).toFixed(2)} s`;
  const found = problemsAt(number);
  get("reasons").textContent = found.map(([, , words]) => words).join("; ");
  moveCursor(number);
}

// Keep the address of the frame for copying, once it stays.
function keepAddress() {
  history.replaceState(null, "", `#frame=${scene.frames[view.at]}`);
}

function play() {
  if (view.at >= scene.count - 1) show(0);
  player.playing = true;
  controls.play.textContent = "❚❚";
  controls.play.setAttribute("aria-label", "Pause");
  let last = performance.now();
  let number = scene.frames[view.at >= scene.count - 1 ? 0 : view.at];
  const step = (now) => {
    if (!player.playing) return;
    const from = scene.frames[view.at];
    if (Math.abs(number - from) > 2 && !player.busy) number = from; // the reader has moved it
    if (!view.held) number += Math.min((now - last) / 1000, 0.25) * rate * Number(controls.speed.value);
    last = now;
    const place = Math.min(placeOf(Math.floor(number)), scene.count - 1);
    if (place !== view.at && !player.busy) show(place);
    if (number >= scene.frames[scene.count - 1]) {
      show(scene.count - 1);
      pause();
    } else requestAnimationFrame(step);
  };
  requestAnimationFrame(step);
}

function pause() {
  player.playing = false;
  controls.play.textContent = "▶";
  controls.play.setAttribute("aria-label", "Play");
  keepAddress();
}

function goTo(t) {
  player.playing = false;
  controls.play.textContent = "▶";
  show(t);
  keepAddress();
}

// Follow a link such as #frame=123.
function followAddress() {
  const found = /^#frame=(-?\d+)$/.exec(location.hash);
  if (!found) return;
  goTo(placeOf(Number(found[1])));
  scrollBy(0, get("player").getBoundingClientRect().top); // not a page around it, as scrollIntoView does
}

function nextProblem(direction) {
  const here = scene.frames[view.at];
  const firsts = report.problems.map(([first]) => first);
  const other = direction > 0 ? firsts.find((number) => number > here) : firsts.findLast((number) => number < here);
  if (other !== undefined) goTo(placeOf(other));
}

function drawMarks() {
  const canvas = controls.marks;
  const ratio = window.devicePixelRatio || 1;
  canvas.width = canvas.clientWidth * ratio;
  canvas.height = canvas.clientHeight * ratio;
  const pen = canvas.getContext("2d");
  pen.fillStyle = colour("problem");
  const inset = 8 * ratio; // half of the scrubber's knob
  const scale = (canvas.width - 2 * inset) / Math.max(scene.count - 1, 1);
  for (const [first, last] of report.problems) {
    const [a, b] = [placeOf(first), placeOf(last)];
    pen.fillRect(inset + a * scale - ratio, 0, Math.max((b - a) * scale, 2 * ratio), canvas.height - 2 * ratio);
  }
}

function listen() {
  controls.scrubber.max = Math.max(scene.count - 1, 0);
  controls.scrubber.disabled = controls.play.disabled = scene.count < 2;
  controls.frame.min = scene.frames[0];
  controls.frame.max = scene.frames[scene.count - 1];
  controls.scrubber.addEventListener("input", () => show(Number(controls.scrubber.value)));
  controls.scrubber.addEventListener("change", keepAddress);
  controls.frame.addEventListener("change", () => {
    goTo(placeOf(Number(controls.frame.value)));
    controls.frame.value = scene.frames[view.at]; // the frame there is, whatever was typed
  });
  controls.play.addEventListener("click", () => (player.playing ? pause() : play()));
  get("previous").addEventListener("click", () => nextProblem(-1));
  get("next").addEventListener("click", () => nextProblem(1));
  get("previous").disabled = get("next").disabled = report.problems.length === 0;
  listenToChoices();
  view.div.addEventListener("pointerdown", () => { view.held = true; });
  window.addEventListener("pointerup", () => {
    view.held = false;
    if (player.wanted !== null) show(player.wanted);
  });
  for (const div of clickable) {
    div.on?.("plotly_click", ({ points }) => goTo(placeOf(points[0].x)));
  }
  charts.lines?.on("plotly_relayout", () => moveCursor(scene.frames[view.at]));
  window.addEventListener("hashchange", followAddress);
  window.addEventListener("resize", () => { drawMarks(); moveCursor(scene.frames[view.at]); });
}

function listenToChoices() {
  for (const choice of document.querySelectorAll("input[name=pose]")) {
    choice.addEventListener("change", async () => {
      view.pose = choice.value;
      await setShown("ellipsoids", view.ellipsoids && hasErrors());
      show(view.at);
    });
  }
  get("ellipsoids").addEventListener("change", async (event) => {
    view.ellipsoids = event.target.checked;
    await setShown("ellipsoids", view.ellipsoids && hasErrors());
    show(view.at);
  });
  get("cameras").addEventListener("change", async (event) => {
    await setShown("cameras", event.target.checked);
    await setShown("names", event.target.checked);
  });
  get("places").addEventListener("change", (event) => setShown("places", event.target.checked));
  get("path").addEventListener("change", (event) => setShown("path", event.target.checked));
  get("follow").addEventListener("change", ({ target }) => {
    view.follow = target.type === "checkbox" ? target.checked && scene.people[0] : scene.people[target.value];
    show(view.at);
  });
  get("fit-person").addEventListener("click", () => setCamera(lookAt("person")));
  get("fit-all").addEventListener("click", () => setCamera(lookAt("all")));
}

// Draw everything again in the colours that now hold.
async function recolour() {
  const camera = liveCamera();
  await openView();
  await setCamera(camera);
  for (const draw of drawings) await draw();
  drawMarks();
}

async function open() {
  await openView();
  for (const draw of drawings) await draw();
  listen();
  drawMarks();
  tellFrame(0);
  followAddress();
  if (window !== window.top) scrollBy(0, get("play").getBoundingClientRect().bottom - innerHeight); // beside its findings
  document.documentElement.dataset.ready = "yes";
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recolour);
}

open();
