// The 3D view: few traces, of which a frame changes the coordinates.
"use strict";

const EMPTY = coordinates();
const MOST_LABELS = 60;
const WITH_PLACES = scene.cameras.some(({ root }) => root); // it is about the cameras
const MOST_PATH = 300; // points; every trace is redrawn with every frame
const CONFIG = {
  displaylogo: false, responsive: true, scrollZoom: true,
  showSendToCloud: false, plotlyServerURL: "", // a recording of a person does not leave the machine
  plotGlPixelRatio: Math.min(Math.max(devicePixelRatio, 1), 2), // 2 by default: four times the pixels of most screens
};
let colourOfGroup = [];

const view = {
  div: document.getElementById("view"),
  pose: "refined",
  ellipsoids: document.getElementById("ellipsoids").checked,
  follow: null, // a person
  held: false, // the pointer turns the view: frames wait
  at: 0,
};

// Names of the traces that change, in their order, and of those that stay.
const MOVING = [...GROUPS.map((_, k) => `limbs ${k}`), "before", "ok", "other", "labels", "ellipsoids"];
const FIXED = ["floor", "axes", "path", "cameras", "names", "places"];

function moving(t) {
  const pose = scene[view.pose === "both" ? "refined" : view.pose];
  const errors = view.ellipsoids && hasErrors();
  return [
    ...GROUPS.map((_, group) => bones(pose, t, group)),
    view.pose === "both" ? bones(scene.alone ?? scene.start, t, null) : EMPTY,
    joints(pose, t, true),
    joints(pose, t, false),
    labels(pose, t),
    errors ? ellipsoids(t) : null,
  ];
}

// Whether the pose that is shown is the one with error bars.
function hasErrors() {
  return view.pose === "refined" || view.pose === "both";
}

function traces(t) {
  colourOfGroup = GROUPS.map(colour);
  const limbs = moving(t);
  const [before, ok, other, names, errors] = limbs.splice(GROUPS.length);
  const line = { type: "scatter3d", mode: "lines", hoverinfo: "skip", showlegend: false };
  const drawn = limbs.map((part, k) => ({ ...line, ...xyz(part), line: { color: colourOfGroup[k], width: 7 } }));
  drawn.push({ ...line, ...xyz(before), line: { color: colour("start"), width: 4 } });
  const dots = { ...line, mode: "markers", hoverinfo: "text" };
  drawn.push({ ...dots, ...xyz(ok), text: ok.texts, marker: { size: 4, color: ok.colours } });
  drawn.push({
    ...dots, ...xyz(other), text: other.texts,
    marker: { size: 7, symbol: "circle-open", color: other.colours, line: { width: 2 } },
  });
  drawn.push({ ...line, ...xyz(names), mode: "text", text: names.texts, textfont: { color: names.colours, size: 13 } });
  drawn.push({
    type: "mesh3d", ...(errors ?? ellipsoids(t)), ...faces(scene.joints.length), visible: errors !== null, opacity: 0.35,
    facecolor: scene.sides.flatMap((side) => SPHERE.faces.map(() => colourOfGroup[side])),
    hoverinfo: "skip", flatshading: false, lighting: { ambient: 0.8, diffuse: 0.4, specular: 0 },
  });
  return [...drawn, ...surroundings(line)];
}

function xyz({ x, y, z }) {
  return { x, y, z };
}

// What stays: floor, axes of the world, paths of the people on the floor, cameras and their names.
function surroundings(line) {
  const ground = floor();
  const soft = { color: colour("camera"), size: 12 };
  const names = scene.cameras.map((camera) => escaped(camera.name));
  const centres = coordinates();
  const pyramids = coordinates();
  for (const camera of scene.cameras) {
    push(centres, (poles(camera)[5] ?? camera.centre).map((mm) => mm / 1000)); // names are above ellipsoids
    for (const points of pyramid(camera)) [...points, null].forEach((point) => push(pyramids, point));
  }
  return [
    { ...line, ...ground.lines, line: { color: colour("floor"), width: 1.5 } },
    {
      ...line, ...ground.axes, mode: "lines+text", text: ground.texts, textfont: soft,
      line: { color: colour("camera"), width: 4 },
    },
    pathsOnFloor(line, ground.height),
    { ...line, ...pyramids, line: { color: colour("camera"), width: 2.5 } },
    {
      ...line, ...centres, mode: names.length > MOST_LABELS ? "markers" : WITH_PLACES ? "text" : "markers+text", text: names,
      hoverinfo: "text", textposition: "top center", textfont: soft,
      marker: { size: 3, color: colour("camera") },
    },
    {
      type: "mesh3d", ...placesOfCameras(), ...faces(scene.cameras.length), visible: document.getElementById("places").checked,
      color: colour("place"), opacity: 0.45, hoverinfo: "skip", flatshading: false, lighting: { ambient: 0.8, diffuse: 0.4, specular: 0 },
    },
  ];
}

// The ends of the ellipsoid of a camera's place along each axis, the last above; none without one.
function poles({ centre, root }) {
  return (root ?? []).flatMap((row, axis) => [-1, 1].map((sign) => centre.map((mm, k) => (k === axis ? mm + sign * Math.hypot(...row) : mm))));
}

// The corners of the ellipsoids of all cameras' places; of an unknown one all in one point.
function placesOfCameras() {
  const corners = coordinates();
  for (const { centre, root } of scene.cameras) {
    for (const corner of SPHERE.corners) {
      const away = (root ?? []).map((row) => dot(row, corner));
      push(corners, centre.map((mm, axis) => (mm + (away[axis] ?? 0)) / 1000));
    }
  }
  return corners;
}

// The lines of a camera's pyramid and a triangle on its upper edge.
function pyramid(camera) {
  const inMetres = (point) => point.map((mm) => mm / 1000);
  const centre = inMetres(camera.centre);
  const [a, b, c, d] = camera.corners.map(inMetres);
  const above = [0, 1, 2].map((axis) => (a[axis] + b[axis]) / 2 + 0.35 * ((a[axis] + b[axis]) / 2 - (c[axis] + d[axis]) / 2));
  return [[a, b, c, d, a], [a, centre, b], [c, centre, d], [a, above, b]];
}

const PERSON = 1.5; // m; around what is smaller, such as an animal, everything is nearer in proportion

// The space: the person's way (reach) and all cameras, with room for a start that lies outside.
const SPACE = space();

function space() {
  const reach = scene.reach.map((corner) => corner.map((mm) => mm / 1000));
  const points = scene.cameras.flatMap((camera) => [camera.centre, ...camera.corners, ...poles(camera)]);
  const low = [0, 1, 2].map((axis) => Math.min(reach[0][axis], ...points.map((p) => p[axis] / 1000)));
  const high = [0, 1, 2].map((axis) => Math.max(reach[1][axis], ...points.map((p) => p[axis] / 1000)));
  const size = Math.max(...[0, 1, 2].map((axis) => reach[1][axis] - reach[0][axis]));
  return { low: low.map((value) => value - 1.6), high: high.map((value) => value + 1.6), reach, scale: Math.min(1, size / PERSON) };
}

// The squares of the floor, at the height of the feet: of a person half a metre or more beyond their way.
const FLOOR = squares();

function squares() {
  const [low, high] = SPACE.reach;
  const extent = Math.max(high[0] - low[0], high[1] - low[1]) + 2 * SPACE.scale;
  const cell = [0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10, 50, 100].find((size) => extent / size <= 12) ?? extent / 12;
  const from = [0, 1].map((axis) => Math.floor((low[axis] - 0.6 * SPACE.scale) / cell));
  const to = [0, 1].map((axis) => Math.ceil((high[axis] + 0.6 * SPACE.scale) / cell));
  return { cell, from, to, height: scene.floor_mm / 1000 };
}

// The floor as lines, and the world's axes at its corner.
function floor() {
  const { cell, from, to, height } = FLOOR;
  const lines = coordinates();
  const add = (a, b) => [[...a, height], [...b, height], null].forEach((point) => push(lines, point));
  for (let k = from[0]; k <= to[0]; k += 1) add([k * cell, from[1] * cell], [k * cell, to[1] * cell]);
  for (let k = from[1]; k <= to[1]; k += 1) add([from[0] * cell, k * cell], [to[0] * cell, k * cell]);
  const corner = [from[0] * cell, from[1] * cell, height];
  const axes = coordinates();
  const texts = [];
  scene.axes.forEach((name, axis) => {
    const tip = corner.map((value, k) => value + (k === axis ? 0.5 * SPACE.scale : 0));
    [corner, tip, null].forEach((point) => push(axes, point));
    texts.push("", name, "");
  });
  const where = `${(1000 * height).toFixed(0)} mm`;
  document.getElementById("grid-size").textContent =
    `floor grid: ${cell} m squares at ${scene.axes[2]} = ${where}${scene.floor_known ? "" : ", the usual height of the lowest joint"}`;
  return { lines, axes, texts, height };
}

// Where the people went, on the floor: the middle joint of some hundred frames.
function pathsOnFloor(line, height) {
  const path = coordinates();
  const colours = [];
  const every = Math.ceil(scene.count / MOST_PATH);
  scene.people.forEach((person, k) => {
    for (let t = 0; t < scene.count; t += every) {
      const point = middle(scene.refined, t, person);
      push(path, point ? [point[0], point[1], height] : null);
    }
    push(path, null);
    while (colours.length < path.x.length) colours.push(person.name ? colourOfGroup[k] : colour("start"));
  });
  return { ...line, ...path, line: { color: colours, width: 3 } };
}

function sceneLayout() {
  const { low, high } = SPACE;
  const axis = (k) => ({ visible: false, range: [low[k], high[k]], autorange: false });
  const length = high.map((value, k) => value - low[k]);
  return {
    xaxis: axis(0), yaxis: axis(1), zaxis: axis(2),
    aspectmode: "manual", aspectratio: { x: length[0], y: length[1], z: length[2] }, // 1 is a metre
    dragmode: "turntable", bgcolor: colour("paper"), camera: firstLook(),
  };
}

// A point in metres as Plotly's camera counts: from the middle of the space.
function inView(point) {
  const { low, high } = SPACE;
  return point.map((value, k) => value - (low[k] + high[k]) / 2);
}

const HALF_ANGLE = Math.tan(Math.PI / 8); // Plotly sees 45° from top to bottom
const EDGE = { across: 60, up: 40 }; // px that stay free on each side, for the cameras' names
const LEAST_DISTANCE = 1.6 * SPACE.scale; // m

// From here the view is opened, and turned by these degrees if names of people would cover those of cameras.
const TOWARDS = unit([-0.62, -0.72, 0.32]);
const TURNS = [0, 10, -10, 20, -20, 30, -30, 45, -45];

// Of one person their way; of several, and where it is about the cameras, all of these.
function firstLook() {
  if (!scene.people[0].name && !WITH_PLACES) return lookAt("person");
  const looks = TURNS.map((degrees) => lookAt("all", turned(TOWARDS, degrees)));
  const covered = looks.map(coveredNames);
  return looks[covered.indexOf(Math.min(...covered))];
}

function turned([x, y, z], degrees) {
  const [c, s] = [Math.cos((degrees * Math.PI) / 180), Math.sin((degrees * Math.PI) / 180)];
  return [c * x - s * y, s * x + c * y, z];
}

// How many names of people, and of cameras with ellipsoids, overlap with another camera in the first frame.
function coveredNames({ eye, center }) {
  const from = [eye.x, eye.y, eye.z];
  const towards = unit([eye.x - center.x, eye.y - center.y, eye.z - center.z]);
  const right = unit(cross([0, 0, 1], towards));
  const above = cross(towards, right);
  const inPixels = (point) => {
    const away = inView(point).map((value, k) => value - from[k]);
    return [right, above].map((axis) => (view.div.clientHeight / 2 / HALF_ANGLE) * (dot(away, axis) / -dot(away, towards)));
  };
  const { x, y, z } = labels(scene.refined, 0);
  const people = x.map((_, k) => inPixels([x[k], y[k], z[k]]));
  const inMetres = (point) => point.map((mm) => mm / 1000);
  const cameras = scene.cameras.map(({ centre }) => inPixels(inMetres(centre)));
  const names = WITH_PLACES ? scene.cameras.map((camera) => inPixels(inMetres(poles(camera)[5] ?? camera.centre))) : [];
  const near = (a, b) => Math.abs(a[0] - b[0]) < 70 && Math.abs(a[1] - b[1]) < 30;
  const covered = (a, place) => cameras.filter((b, k) => k !== place && near(a, b));
  return [...people.flatMap((a) => covered(a)), ...names.flatMap(covered)].length;
}

// A camera that sees the person's way, or all cameras too, from a little above and as large as the view allows.
function lookAt(what, towards = TOWARDS) {
  const [low, high] = SPACE.reach;
  const box = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((axis) => ((k >> axis) & 1 ? high : low)[axis]));
  const cameras = scene.cameras.flatMap((camera) => [camera.centre, ...camera.corners, ...poles(camera)]);
  const others = cameras.map((point) => point.map((mm) => mm / 1000));
  others.push([...FLOOR.from.map((k) => k * FLOOR.cell), FLOOR.height]); // the axes
  return fit((what === "person" ? box : [...box, ...others]).map(inView), towards);
}

// The nearest camera in direction `towards` whose view holds all `points`.
function fit(points, towards) {
  const right = unit(cross([0, 0, 1], towards));
  const above = cross(towards, right);
  const [width, height] = [view.div.clientWidth, view.div.clientHeight];
  const sides = [
    [right, (HALF_ANGLE * Math.max(width - 2 * EDGE.across, width / 2)) / height],
    [above, (HALF_ANGLE * Math.max(height - 2 * EDGE.up, height / 2)) / height],
  ].map(([axis, slope]) => {
    // A point is seen while its distance from the view's axis is at most `slope` times its depth.
    const ends = [1, -1].map((sign) => Math.max(...points.map((p) => dot(p, towards) + (sign * dot(p, axis)) / slope)));
    return { axis, middle: (slope * (ends[0] - ends[1])) / 2, depth: (ends[0] + ends[1]) / 2 };
  });
  const aim = points.reduce((sum, p) => sum + dot(p, towards), 0) / points.length; // what the pointer turns about
  const depth = Math.max(...sides.map((side) => side.depth), aim + LEAST_DISTANCE);
  const at = (along) => towards.map((value, k) => along * value + sides[0].middle * right[k] + sides[1].middle * above[k]);
  const named = ([x, y, z]) => ({ x, y, z });
  return { up: { x: 0, y: 0, z: 1 }, center: named(at(aim)), eye: named(at(depth)) };
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function cross([a, b, c], [x, y, z]) {
  return [b * z - c * y, c * x - a * z, a * y - b * x];
}

// The camera as the pointer has left it: Plotly tells its layout only when the pointer lets go.
function liveCamera() {
  const live = view.div._fullLayout?.scene?._scene?.getCamera?.();
  return live ?? view.div.layout.scene.camera;
}

function followed(t) {
  const camera = liveCamera();
  const centre = view.follow && (middle(scene.refined, t, view.follow) ?? (scene.start && middle(scene.start, t, view.follow)));
  if (!centre) return camera;
  const [x, y, z] = inView(centre);
  const { eye, center } = camera;
  return {
    ...camera, center: { x, y, z },
    eye: { x: eye.x + x - center.x, y: eye.y + y - center.y, z: eye.z + z - center.z },
  };
}

async function openView() {
  const layout = {
    scene: sceneLayout(), margin: { l: 0, r: 0, t: 0, b: 0 }, paper_bgcolor: colour("paper"),
    hoverlabel: { font: { size: 13 } }, showlegend: false,
  };
  const remove = ["resetCameraLastSave3d", "resetCameraDefault3d", "tableRotation", "hoverClosest3d"];
  await Plotly.newPlot(view.div, traces(view.at), layout, { ...CONFIG, modeBarButtonsToRemove: remove });
}

// Draw the frame at place `t`.
async function drawFrame(t) {
  view.at = t;
  const parts = moving(t);
  const shown = parts.at(-1) ? MOVING.length : MOVING.length - 1; // the ellipsoids are last
  const some = parts.slice(0, shown);
  const change = { x: some.map((p) => p.x), y: some.map((p) => p.y), z: some.map((p) => p.z) };
  change.text = some.map((p) => p.texts);
  change["marker.color"] = some.map((p) => p.colours);
  change["textfont.color"] = some.map((p) => p.colours);
  await Plotly.update(view.div, change, { "scene.camera": followed(t) }, some.map((_, k) => k));
}

async function setShown(name, visible) {
  await Plotly.restyle(view.div, { visible }, [[...MOVING, ...FIXED].indexOf(name)]);
}

async function setCamera(camera) {
  await Plotly.relayout(view.div, { "scene.camera": camera });
}
