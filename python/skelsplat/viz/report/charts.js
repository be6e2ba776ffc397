// The heat map and the curves.
"use strict";

const charts = { heat: document.getElementById("heat"), lines: document.getElementById("lines"), cursor: document.getElementById("cursor") };
const MARGIN = { l: 64, r: 16 };
const ROW = 118; // height of a curve with its title, px
const LINE = { top: 26, height: 78 };
const MOST_CELLS = 240; // beyond, numbers in the cells cannot be read
const HEAT = {
  errors: { values: floatsOf(report.heat.errors), title: "px", words: "median error %{z:.1f} px", format: "%{z:.0f}", scale: 1 },
  rejected: { values: floatsOf(report.heat.rejected), title: "%", words: "%{z:.0f}% rejected", format: "%{z:.0f}", scale: 100 },
};

function baseLayout(height) {
  return {
    height, paper_bgcolor: colour("paper"), plot_bgcolor: colour("paper"), showlegend: false,
    font: { color: colour("ink"), size: 12, family: getComputedStyle(document.body).fontFamily },
    hoverlabel: { font: { size: 13 } },
  };
}

function shorten(name, most) {
  return name.length > most ? `${name.slice(0, most - 1)}…` : name;
}

function drawHeat(kind) {
  const { cameras, joints } = report.heat;
  const { values, title, words, format, scale } = HEAT[kind];
  const rows = cameras.map((_, i) => joints.map((__, j) => {
    const value = values[i * joints.length + j];
    return value === null ? null : scale * value;
  }));
  const dark = colour("paper") !== "#ffffff";
  const names = cameras.map((name) => escaped(name));
  const hover = cameras.map((name) => joints.map((joint) => `${escaped(name)}, ${escaped(joint)}`));
  const cell = cameras.length > 40 ? 16 : 26;
  const numbers = cameras.length * joints.length <= MOST_CELLS && charts.heat.clientWidth >= 24 * joints.length + 120;
  const trace = {
    type: "heatmap", z: rows, customdata: hover, xgap: 1, ygap: 1, zmin: 0,
    colorscale: dark ? [[0, "#1f2a30"], [0.5, "#2f7fb0"], [1, "#bfe4ff"]] : [[0, "#f2f7fb"], [0.5, "#5ba3cf"], [1, "#08306b"]],
    zmax: kind === "rejected" ? 100 : Math.max(1e-9, ...rows.flat()), hovertemplate: `%{customdata}<br>${words}<extra></extra>`,
    texttemplate: numbers ? format : "", colorbar: { title: { text: title }, thickness: 12, outlinewidth: 0, lenmode: "pixels", len: Math.max(130, cell * cameras.length), y: 1, yanchor: "top", nticks: 5 },
  };
  const some = Math.ceil(joints.length / Math.max(4, Math.floor(charts.heat.clientWidth / 18)));
  const ticks = joints.map((_, j) => j).filter((j) => j % some === 0);
  const layout = {
    ...baseLayout(cell * cameras.length + 150), margin: { l: 110, r: 10, t: 8, b: 120 }, plot_bgcolor: colour("empty"),
    xaxis: { tickvals: ticks, ticktext: ticks.map((j) => escaped(shorten(joints[j], 18))), tickangle: -45, range: [-0.5, joints.length - 0.5], fixedrange: true, showgrid: false, zeroline: false },
    yaxis: { tickvals: cameras.map((_, i) => i), ticktext: names.map((name) => shorten(name, 16)), range: [cameras.length - 0.5, -0.5], fixedrange: true, showgrid: false, zeroline: false },
  };
  return Plotly.react(charts.heat, [trace], layout, { ...CONFIG, scrollZoom: false, displayModeBar: false });
}

function drawLines() {
  const lines = report.lines.map((line) => ({ ...line, values: floatsOf(line.values), beside: line.beside && floatsOf(line.beside) }));
  const total = lines.length * ROW + 30;
  const frames = Array.from(scene.frames);
  const mode = frames.length > 60 ? "lines" : "lines+markers";
  const layout = {
    ...baseLayout(total), margin: { ...MARGIN, t: 0, b: 30 }, hovermode: "x", annotations: [],
    xaxis: { title: "", gridcolor: colour("line"), zeroline: false, anchor: `y${lines.length}`, range: wholeRange(frames), tickformat: "d", dtick: frames.at(-1) - frames[0] < 8 ? 1 : null },
  };
  const drawn = [];
  lines.forEach((line, k) => {
    const name = k ? `y${k + 1}` : "y";
    const top = 1 - (k * ROW + LINE.top) / (total - 30);
    const unit = line.unit ? ` [${line.unit}]` : "";
    layout[`yaxis${k ? k + 1 : ""}`] = {
      domain: [top - LINE.height / (total - 30), top], gridcolor: colour("line"), zeroline: false,
      rangemode: "tozero", nticks: 4, fixedrange: true,
    };
    layout.annotations.push({
      text: `${escaped(line.title)}${unit}${line.beside && charts.lines.clientWidth > 520 ? ` (grey: ${escaped(line.beside_name)})` : ""}`,
      xref: "paper", yref: "paper", x: 0, y: top, xanchor: "left", yanchor: "bottom", showarrow: false,
    });
    const base = { x: frames, yaxis: name, mode, marker: { size: 4 }, type: "scatter" };
    const hovertemplate = `%{y:.3~g} ${line.unit}<extra></extra>`;
    if (line.beside) drawn.push({ ...base, y: line.beside, line: { color: colour("start"), width: 1 }, hovertemplate });
    drawn.push({ ...base, y: line.values, line: { color: colour("left"), width: 1.5 }, hovertemplate });
  });
  return Plotly.react(charts.lines, drawn, layout, { ...CONFIG, scrollZoom: false, displayModeBar: false });
}

function wholeRange(frames) {
  const margin = Math.max(0.5, 0.005 * (frames.at(-1) - frames[0]));
  return [frames[0] - margin, frames.at(-1) + margin];
}

// Put the mark of the current frame over the curves, by the range that is shown.
function moveCursor(number) {
  const [from, to] = charts.lines.layout?.xaxis?.range ?? [0, 0];
  const width = charts.lines.clientWidth - MARGIN.l - MARGIN.r;
  const part = (number - from) / (to - from);
  charts.cursor.hidden = !(part >= 0 && part <= 1);
  charts.cursor.style.left = `${MARGIN.l + part * width}px`;
  charts.cursor.style.height = `${charts.lines.clientHeight - 30}px`;
}
