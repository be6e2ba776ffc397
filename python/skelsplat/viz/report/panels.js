// Small charts side by side: the trajectory of a joint, and of a solution over time bones and speeds.
"use strict";

const PANEL = { height: 132, title: 22, foot: 18, between: 58 }; // px
const PERCENT = [0.01, 0.99]; // beyond, single frames do not widen a panel
const MOST_WIDER = 1; // by which thin lines widen a panel on either side, in parts of what else is drawn
const trajectory = { div: document.getElementById("trajectory"), joint: document.getElementById("trajectory-joint") };
const inTime = { bones: document.getElementById("bones"), speeds: document.getElementById("speeds") };

// Draw panels {title, lines: [{y, colour, width, words}], bands: [{low, high, colour}]} into an element.
function drawPanels(div, panels, unit) {
  const width = div.clientWidth - MARGIN.l - MARGIN.r;
  const columns = Math.min(panels.length, width > 820 ? 3 : width > 480 ? 2 : 1);
  const rows = Math.ceil(panels.length / columns);
  const height = rows * PANEL.height;
  const part = { across: PANEL.between / width, wide: (width + PANEL.between) / columns / width };
  const frames = Array.from(scene.frames);
  const layout = { ...baseLayout(height + 30), margin: { ...MARGIN, t: 0, b: 30 }, annotations: [] };
  const traces = [];
  panels.forEach((panel, k) => {
    const [row, column] = [Math.floor(k / columns), k % columns];
    const name = k ? k + 1 : "";
    const left = column * part.wide;
    const top = 1 - (row * PANEL.height + PANEL.title) / height;
    const bottom = 1 - ((row + 1) * PANEL.height - PANEL.foot) / height;
    const right = Math.min(1, left + part.wide - part.across);
    const line = { gridcolor: colour("line"), zeroline: false };
    layout[`xaxis${name}`] = { ...line, domain: [left, right], anchor: `y${name}`, range: wholeRange(frames), nticks: 5, tickformat: "d", matches: k ? "x" : undefined, showticklabels: k + columns >= panels.length };
    layout[`yaxis${name}`] = { ...line, domain: [bottom, top], anchor: `x${name}`, range: panelRange(panel), nticks: 4, fixedrange: true };
    layout.annotations.push({ text: escaped(panel.title), xref: "paper", yref: "paper", x: left, y: top, xanchor: "left", yanchor: "bottom", showarrow: false });
    const base = { x: frames, xaxis: `x${name}`, yaxis: `y${name}`, type: "scatter", mode: frames.length > 60 ? "lines" : "lines+markers", marker: { size: 3 } };
    for (const band of panel.bands) {
      const edge = { ...base, mode: "lines", line: { width: 0 }, hoverinfo: "skip" };
      traces.push({ ...edge, y: band.low }, { ...edge, y: band.high, fill: "tonexty", fillcolor: faint(band.colour) });
    }
    for (const { y, words, ...style } of panel.lines) {
      traces.push({ ...base, y, line: { color: style.colour, width: style.width }, opacity: style.opacity ?? 1, hovertemplate: `%{y:.4~g} ${unit}, ${words}<extra></extra>` });
    }
  });
  return Plotly.react(div, traces, layout, { ...CONFIG, scrollZoom: false, displayModeBar: false });
}

// The range of all lines but for their outermost frames, and of the bands; thin lines widen it by so much at most.
function panelRange(panel) {
  const thick = panel.lines.filter(({ opacity }) => opacity === undefined);
  const found = extent([...thick.map(({ y }) => y), ...panel.bands.flatMap(({ low, high }) => [low, high])]);
  const all = extent(panel.lines.map(({ y }) => y)) ?? [0, 1];
  const [low, high] = found ?? all;
  const room = MOST_WIDER * Math.max(high - low, 0.01 * Math.abs(high), 1e-9);
  const ends = [Math.min(low, Math.max(all[0], low - room)), Math.max(high, Math.min(all[1], high + room))];
  const margin = Math.max(0.08 * (ends[1] - ends[0]), 1e-9);
  return [panel.fromZero ? 0 : ends[0] - margin, ends[1] + margin];
}

function extent(curves) {
  const known = curves.flatMap(quantiles).filter((value) => value !== undefined);
  return known.length ? [Math.min(...known), Math.max(...known)] : null;
}

function quantiles(values) {
  const known = values.filter((value) => value !== null).sort((a, b) => a - b);
  return PERCENT.map((share) => known[Math.round(share * (known.length - 1))]);
}

function overFrames(value) {
  return Array.from({ length: scene.count }, (_, t) => value(t));
}

function colourOf(side) {
  return colour(GROUPS[side]);
}

function sideIn(side, words) {
  return side < 2 ? `${GROUPS[side]}, ${words}` : words;
}

// x, y and z of the chosen joint in mm, with two standard deviations, before in grey.
function drawTrajectory() {
  const j = Number(trajectory.joint.value);
  const before = scene.alone ?? scene.start;
  const own = colourOf(scene.sides[j]);
  const panels = scene.axes.map((axis, k) => {
    const along = (pose) => overFrames((t) => { const point = joint(pose, t, j); return point && 1000 * point[k]; });
    const refined = along(scene.refined);
    const edge = (sign) => overFrames((t) => {
      const root = spread(t, j);
      return root && refined[t] !== null ? refined[t] + sign * SIGMAS * 1000 * deviation(root, k) : null;
    });
    return {
      title: `${axis} [mm]`,
      lines: [{ y: along(before), colour: colour("start"), width: 1, words: scene.grey }, { y: refined, colour: own, width: 1.6, words: scene.refined_name }],
      bands: [{ low: edge(-1), high: edge(1), colour: own }],
    };
  });
  return drawPanels(trajectory.div, panels, "mm");
}

// The standard deviation along an axis: the length of that row of the covariance's root.
function deviation([xx, xy, xz, yy, yz, zz], axis) {
  return Math.hypot(...[[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]][axis]);
}

// Panels by title; left and right share one.
function grouped(entries, titleOf, add, panelOf) {
  const panels = new Map();
  for (const entry of entries) {
    const title = titleOf(entry);
    if (!panels.has(title)) panels.set(title, { title, lines: [], bands: [], ...panelOf });
    add(panels.get(title), entry);
  }
  return [...panels.values()];
}

function nameOf(j) {
  return scene.joints[j].replaceAll("_", " ");
}

// Without the side that the layout has for a joint.
function plainName(j) {
  return scene.sides[j] < 2 ? nameOf(j).replace(/^(left|right) /, "") : nameOf(j);
}

// A bone from one side to the other keeps both.
function boneName({ ends }) {
  const across = [0, 1].every((side) => ends.some((j) => scene.sides[j] === side));
  return ends.map(across ? nameOf : plainName).join(" – ");
}

// Lengths in mm: frame by frame thin, over time thick, and the length of the whole recording with its error.
function drawBones() {
  const add = (panel, { ends: [a, b], length_mm: length, sigma_mm: sigma }) => {
    const sides = new Set([a, b].map((j) => scene.sides[j]).filter((one) => one < 2));
    const side = sides.size === 1 ? [...sides][0] : 2;
    const own = colourOf(side);
    const lengths = (pose) => overFrames((t) => {
      const [from, to] = [joint(pose, t, a), joint(pose, t, b)];
      return from && to ? 1000 * Math.hypot(...from.map((value, k) => value - to[k])) : null;
    });
    panel.lines.push({ y: lengths(scene.alone), colour: own, width: 0.8, opacity: 0.55, words: sideIn(side, "frame by frame") });
    panel.lines.push({ y: lengths(scene.refined), colour: own, width: 1.8, words: sideIn(side, "over time") });
    if (length !== null && sigma !== null) {
      panel.bands.push({ low: overFrames(() => length - sigma), high: overFrames(() => length + sigma), colour: own });
    }
  };
  return drawPanels(inTime.bones, grouped(report.bones, boneName, add, {}), "mm");
}

function drawSpeeds() {
  const add = (panel, j) => {
    const y = overFrames((t) => {
      const number = scene.speeds[t * scene.joints.length + j];
      return number === MISSING ? null : (scene.speedStep * number) / 1000;
    });
    panel.lines.push({ y, colour: colourOf(scene.sides[j]), width: 1.4, words: sideIn(scene.sides[j], plainName(j)) });
  };
  return drawPanels(inTime.speeds, grouped(scene.joints.keys(), plainName, add, { fromZero: true }), "m/s");
}

async function drawAllPanels() {
  await drawTrajectory();
  if (!report.bones) return;
  if (report.bones.length) await drawBones();
  await drawSpeeds();
}

function chooseJoint() {
  trajectory.joint.replaceChildren(...scene.joints.map((name, j) => new Option(name.replaceAll("_", " "), j)));
  trajectory.joint.value = Math.max(0, scene.joints.findIndex((name) => /wrist/i.test(name)));
  trajectory.joint.addEventListener("change", drawTrajectory);
}

chooseJoint();
drawings.push(drawAllPanels);
clickable.push(...[trajectory.div, inTime.bones, inTime.speeds].filter((div) => div));
