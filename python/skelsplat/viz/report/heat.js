// The heat map of cameras and joints.
"use strict";

const heatMap = document.getElementById("heat");
const MOST_CELLS = 240; // beyond, numbers in the cells cannot be read
const HEAT = {
  errors: { values: floatsOf(report.heat.errors), title: "px", words: "median error %{z:.1f} px", format: "%{z:.0f}", scale: 1 },
  rejected: { values: floatsOf(report.heat.rejected), title: "%", words: "%{z:.0f}% rejected", format: "%{z:.0f}", scale: 100 },
};

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
  const numbers = cameras.length * joints.length <= MOST_CELLS && heatMap.clientWidth >= 24 * joints.length + 120;
  const trace = {
    type: "heatmap", z: rows, customdata: hover, xgap: 1, ygap: 1, zmin: 0,
    colorscale: dark ? [[0, "#1f2a30"], [0.5, "#2f7fb0"], [1, "#bfe4ff"]] : [[0, "#f2f7fb"], [0.5, "#5ba3cf"], [1, "#08306b"]],
    zmax: kind === "rejected" ? 100 : Math.max(1e-9, ...rows.flat()), hovertemplate: `%{customdata}<br>${words}<extra></extra>`,
    texttemplate: numbers ? format : "", colorbar: { title: { text: title }, thickness: 12, outlinewidth: 0, lenmode: "pixels", len: Math.max(130, cell * cameras.length), y: 1, yanchor: "top", nticks: 5 },
  };
  const some = Math.ceil(joints.length / Math.max(4, Math.floor(heatMap.clientWidth / 18)));
  const ticks = joints.map((_, j) => j).filter((j) => j % some === 0);
  const layout = {
    ...baseLayout(cell * cameras.length + 150), margin: { l: 110, r: 10, t: 8, b: 120 }, plot_bgcolor: colour("empty"),
    xaxis: { tickvals: ticks, ticktext: ticks.map((j) => escaped(shorten(joints[j], 18))), tickangle: -45, range: [-0.5, joints.length - 0.5], fixedrange: true, showgrid: false, zeroline: false },
    yaxis: { tickvals: cameras.map((_, i) => i), ticktext: names.map((name) => shorten(name, 16)), range: [cameras.length - 0.5, -0.5], fixedrange: true, showgrid: false, zeroline: false },
  };
  return Plotly.react(heatMap, [trace], layout, { ...CONFIG, scrollZoom: false, displayModeBar: false });
}

async function drawChosenHeat() {
  await drawHeat(document.querySelector("input[name=heat]:checked").value);
}

for (const choice of document.querySelectorAll("input[name=heat]")) choice.addEventListener("change", drawChosenHeat);
drawings.push(drawChosenHeat);
