// The curves over the frames, and above them a row per person: who is there when.
"use strict";

const charts = { lines: document.getElementById("lines"), cursor: document.getElementById("cursor") };
const MARGIN = { l: report.bars ? 84 : 64, r: 16 };
const ROW = 118; // height of a curve with its title, px
const LINE = { top: 26, height: 78 };
const BAR = 24; // height of a person's row, px
const PALEST = 0.22; // of a person's colour

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

function drawLines() {
  const frames = Array.from(scene.frames);
  const bars = report.bars ? barsOf(frames) : { height: 0, traces: [], annotations: [] };
  const inside = bars.height + report.lines.length * ROW;
  const mode = frames.length > 60 ? "lines" : "lines+markers";
  const layout = {
    ...baseLayout(inside + 30), margin: { ...MARGIN, t: 0, b: 30 }, hovermode: report.bars ? "closest" : "x", annotations: [],
    xaxis: { title: "", gridcolor: colour("line"), zeroline: false, anchor: `y${report.lines.length}`, range: wholeRange(frames), tickformat: "d", dtick: frames.at(-1) - frames[0] < 8 ? 1 : null },
  };
  const drawn = [...bars.traces];
  const write = (text, top) => layout.annotations.push({ text, xref: "paper", yref: "paper", x: 0, y: top, xanchor: "left", yanchor: "bottom", showarrow: false });
  report.lines.forEach((line, k) => {
    const top = 1 - (bars.height + k * ROW + LINE.top) / inside;
    layout[`yaxis${k ? k + 1 : ""}`] = {
      domain: [top - LINE.height / inside, top], gridcolor: colour("line"), zeroline: false,
      rangemode: "tozero", range: line.range, nticks: 4, fixedrange: true,
    };
    const unit = line.unit ? ` [${line.unit}]` : "";
    const grey = line.curves.find((curve) => curve.colour === "start");
    const meaning = grey ? ` (grey: ${escaped(grey.name)})` : line.curves.some(({ sigma }) => sigma) ? " (bands: error bars, 1 σ)" : "";
    write(`${escaped(line.title)}${unit}${charts.lines.clientWidth > 520 ? meaning : ""}`, top);
    for (const { name, colour: own, values, sigma } of line.curves) {
      const words = own === "start" || !name ? "" : `, ${escaped(name)}`;
      const [y, sigmas, yaxis] = [floatsOf(values), sigma && floatsOf(sigma), k ? `y${k + 1}` : "y"];
      if (sigma) drawn.push({ ...bandOf(frames, y, sigmas), yaxis, fillcolor: faint(colour(own)) });
      drawn.push({
        x: frames, y, yaxis, mode, marker: { size: 4 }, type: "scatter",
        text: sigmas?.map((one) => (Number.isFinite(one) ? ` ± ${Number(one.toPrecision(2))}` : "")),
        line: { color: colour(own), width: own === "start" ? 1 : 1.5 },
        hovertemplate: `%{y:.3~g}${sigma ? "%{text}" : ""} ${line.unit}${words}<extra></extra>`,
      });
    }
  });
  if (report.bars) {
    layout[`yaxis${report.lines.length + 1}`] = { ...bars.axis, domain: [1 - bars.height / inside, 1 - LINE.top / inside] };
    write(bars.title, 1 - LINE.top / inside);
  }
  const tops = report.lines.map((_, k) => bars.height + k * ROW + LINE.top); // the cursor leaves titles free
  const shown = [...(report.bars ? [[LINE.top, bars.height]] : []), ...tops.map((top) => [top, top + LINE.height])];
  const stops = shown.flatMap(([from, to]) => [`transparent 0 ${from}px`, `var(--problem) 0 ${to}px`]);
  charts.cursor.style.background = `linear-gradient(${stops.join()}, transparent 0)`;
  return Plotly.react(charts.lines, drawn, layout, { ...CONFIG, scrollZoom: false, displayModeBar: false });
}

// One standard deviation on either side of a curve: a closed outline around every stretch of frames that has both.
function bandOf(x, y, sigmas) {
  const outline = { x: [], y: [] };
  let stretch = [];
  const close = () => {
    const back = [...stretch].reverse();
    outline.x.push(...stretch.map((t) => x[t]), ...back.map((t) => x[t]), null);
    outline.y.push(...stretch.map((t) => y[t] - sigmas[t]), ...back.map((t) => y[t] + sigmas[t]), null);
    stretch = [];
  };
  x.forEach((_, t) => {
    if (y[t] !== null && Number.isFinite(sigmas[t])) stretch.push(t);
    else if (stretch.length) close();
  });
  if (stretch.length) close();
  return { ...outline, type: "scatter", mode: "lines", line: { width: 0 }, fill: "toself", hoverinfo: "skip" };
}

function faint(hex) {
  return `${hex}38`;
}

// A row per person: a bar while they are there, pale where few views see them.
function barsOf(frames) {
  const { people, views } = report.bars;
  const axis = `y${report.lines.length + 1}`;
  const traces = people.map((person, k) => ({
    type: "heatmap", x: frames, y: [k], z: [countsOf(person.views)], yaxis: axis, zmin: 0, zmax: views, ygap: 4, showscale: false,
    colorscale: [[0, mixed(colour(person.colour), PALEST)], [1, colour(person.colour)]], hoverongaps: false,
    hovertemplate: `${escaped(person.name)}, frame %{x}: %{z} of ${views} views<extra></extra>`,
  }));
  return {
    height: LINE.top + BAR * people.length, traces, title: "Who is there when",
    axis: {
      tickvals: people.map((_, k) => k), ticktext: people.map((person) => escaped(shorten(person.name, 11))),
      range: [people.length - 0.5, -0.5], fixedrange: true, showgrid: false, zeroline: false,
    },
  };
}

// The numbers of views, null where the person is not there.
function countsOf(text) {
  return Array.from(new Int16Array(bytesOf(text)), (count) => (count < 0 ? null : count));
}

// A colour on the page's paper: itself for a share of 1.
function mixed(hex, share) {
  const parts = (text) => [1, 3, 5].map((k) => parseInt(text.slice(k, k + 2), 16));
  const paper = parts(colour("paper"));
  return `rgb(${parts(hex).map((part, k) => Math.round(paper[k] + share * (part - paper[k]))).join()})`;
}

function wholeRange(frames) {
  const margin = Math.max(0.5, 0.005 * (frames.at(-1) - frames[0]));
  return [frames[0] - margin, frames.at(-1) + margin];
}

// Put the mark of the current frame over the curves, by the range that is shown.
function moveCursor(number) {
  if (!charts.lines) return;
  const [from, to] = charts.lines.layout?.xaxis?.range ?? [0, 0];
  const width = charts.lines.clientWidth - MARGIN.l - MARGIN.r;
  const part = (number - from) / (to - from);
  charts.cursor.hidden = !(part >= 0 && part <= 1);
  charts.cursor.style.left = `${MARGIN.l + part * width}px`;
  charts.cursor.style.height = `${charts.lines.clientHeight - 30}px`;
}

if (charts.lines) {
  drawings.push(drawLines);
  clickable.push(charts.lines);
}
