// The data of the page: whole numbers in base64, as viz/report/_scene.py writes them.
"use strict";

const MISSING = -32768;
const report = JSON.parse(document.getElementById("data").textContent);

function bytesOf(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
}

function floatsOf(text) {
  return Array.from(new Float32Array(bytesOf(text)), (value) => (Number.isNaN(value) ? null : value));
}

// Positions come in mm on a grid; the view works in metres.
const scene = {
  ...report.scene,
  frames: new Float64Array(bytesOf(report.scene.frames)),
  start: report.scene.start && new Int16Array(bytesOf(report.scene.start)),
  refined: new Int16Array(bytesOf(report.scene.refined)),
  alone: report.scene.alone && new Int16Array(bytesOf(report.scene.alone)),
  speeds: report.scene.speed && new Int16Array(bytesOf(report.scene.speed.numbers)),
  speedStep: report.scene.speed?.step_mm_s,
  spreads: new Int16Array(bytesOf(report.scene.spread.numbers)),
  statuses: new Uint8Array(bytesOf(report.scene.status.numbers)),
  origin: report.scene.grid.origin.map((mm) => mm / 1000),
  step: report.scene.grid.step_mm / 1000,
  spreadStep: report.scene.spread.step_mm / 1000,
};

// What the programs below add to the page: drawings to make anew in other colours, and charts with frames to click.
const drawings = [];
const clickable = [];

// The place of the frame shown whose number is nearest to `number`.
function placeOf(number) {
  const frames = scene.frames;
  let low = 0;
  let high = frames.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (frames[middle] < number) low = middle + 1;
    else high = middle;
  }
  return low > 0 && number - frames[low - 1] < frames[low] - number ? low - 1 : low;
}

// The first problem row that holds a frame number, or undefined.
function problemsAt(number) {
  return report.problems.filter(([first, last]) => first <= number && number <= last);
}

function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}
