// The heat map of cameras and joints, or of pairs of cameras.
"use strict";

const heatMap = document.getElementById("heat");
const MOST_CELLS = 240; // beyond, numbers in the cells cannot be read

function drawHeat(place) {
  const { rows: names, columns } = report.heat;
  const { unit, words, most, values } = report.heat.kinds[place];
  const all = floatsOf(values);
  const cells = names.map((_, i) => all.slice(i * columns.length, (i + 1) * columns.length));
  const dark = colour("paper") !== "#ffffff";
  const hover = names.map((name) => columns.map((column) => `${escaped(name)}, ${escaped(column)}`));
  const cell = names.length > 40 ? 16 : 26;
  const numbers = names.length * columns.length <= MOST_CELLS && heatMap.clientWidth >= 24 * columns.length + 120;
  const trace = {
    type: "heatmap", z: cells, customdata: hover, xgap: 1, ygap: 1, zmin: 0,
    colorscale: dark ? [[0, "#1f2a30"], [0.5, "#2f7fb0"], [1, "#bfe4ff"]] : [[0, "#f2f7fb"], [0.5, "#5ba3cf"], [1, "#08306b"]],
    zmax: most ?? Math.max(1e-9, ...cells.flat()), hovertemplate: `%{customdata}<br>${escaped(words)}<extra></extra>`,
    texttemplate: numbers ? "%{z:.0f}" : "", colorbar: { title: { text: unit }, thickness: 12, outlinewidth: 0, lenmode: "pixels", len: Math.max(130, cell * names.length), y: 1, yanchor: "top", nticks: 5 },
  };
  const some = Math.ceil(columns.length / Math.max(4, Math.floor(heatMap.clientWidth / 18)));
  const ticks = columns.map((_, j) => j).filter((j) => j % some === 0);
  const layout = {
    ...baseLayout(cell * names.length + 150), margin: { l: 110, r: 10, t: 8, b: 120 }, plot_bgcolor: colour("empty"),
    xaxis: { tickvals: ticks, ticktext: ticks.map((j) => escaped(shorten(columns[j], 18))), tickangle: -45, range: [-0.5, columns.length - 0.5], fixedrange: true, showgrid: false, zeroline: false },
    yaxis: { tickvals: names.map((_, i) => i), ticktext: names.map((name) => escaped(shorten(name, 16))), range: [names.length - 0.5, -0.5], fixedrange: true, showgrid: false, zeroline: false },
  };
  return Plotly.react(heatMap, [trace], layout, { ...CONFIG, scrollZoom: false, displayModeBar: false });
}

async function drawChosenHeat() {
  await drawHeat(Number(document.querySelector("input[name=heat]:checked").value));
}

for (const choice of document.querySelectorAll("input[name=heat]")) choice.addEventListener("change", drawChosenHeat);
drawings.push(drawChosenHeat);
