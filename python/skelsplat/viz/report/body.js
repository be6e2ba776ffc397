// What is drawn of one frame: bones, joints and error ellipsoids, as coordinates in metres.
"use strict";

const GROUPS = scene.groups; // of limbs and joints that share a colour: left, right and middle, or people
const SIGMAS = 2;
const MOST_M = 0.3; // of a person, from a joint to where its ellipsoid is cut off: that of an undetermined one would fill the scene
const SPHERE = sphere();

function coordinates() {
  return { x: [], y: [], z: [] };
}

function push(to, point) {
  to.x.push(point ? point[0] : null);
  to.y.push(point ? point[1] : null);
  to.z.push(point ? point[2] : null);
}

// Position of a joint at place `t`, or null.
function joint(pose, t, j) {
  const at = 3 * (t * scene.joints.length + j);
  if (pose[at] === MISSING) return null;
  return [0, 1, 2].map((axis) => scene.origin[axis] + scene.step * pose[at + axis]);
}

// The limbs of one group (null: of all) as one line with breaks.
function bones(pose, t, group) {
  const line = coordinates();
  for (const [a, b, own] of scene.limbs) {
    const ends = [joint(pose, t, a), joint(pose, t, b)];
    if ((group !== null && own !== group) || !ends[0] || !ends[1]) continue;
    push(line, ends[0]);
    push(line, ends[1]);
    push(line, null);
  }
  return line;
}

// The names of several people above their highest joints.
function labels(pose, t) {
  const points = { ...coordinates(), texts: [], colours: [] };
  scene.people.forEach((person, k) => {
    const top = known(pose, t, person).sort((a, b) => b[2] - a[2])[0];
    if (!person.name || !top) return;
    push(points, [top[0], top[1], top[2] + 0.12 * SPACE.scale]);
    points.texts.push(escaped(person.name));
    points.colours.push(colourOfGroup[k]);
  });
  return points;
}

// The joints whose status is ok, or the others.
function joints(pose, t, ok) {
  const points = { ...coordinates(), colours: [], texts: [] };
  for (let j = 0; j < scene.joints.length; j += 1) {
    const point = joint(pose, t, j);
    if (!point || (statusOf(t, j) === "ok") !== ok) continue;
    push(points, point);
    points.colours.push(colourOfGroup[scene.sides[j]]);
    points.texts.push(tell(t, j));
  }
  return points;
}

function statusOf(t, j) {
  return scene.status.names[scene.statuses[t * scene.joints.length + j]];
}

function tell(t, j) {
  const bar = errorBar(t, j);
  const width = bar === null ? "no error bar" : `error bar ${millimetres(bar)} mm`;
  const cut = bar !== null && surface(spread(t, j)).some(([, share]) => share < 1);
  const note = cut ? `<br>ellipsoid cut off at ${millimetres(MOST_M * SPACE.scale)} mm` : "";
  return `${escaped(scene.joints[j])}<br>${width}, ${statusOf(t, j)}${note}`;
}

// A length as text, with two digits if it is below a millimetre.
function millimetres(metres) {
  const mm = 1000 * metres;
  return mm !== 0 && Math.abs(mm) < 1 ? String(Number(mm.toPrecision(2))) : mm.toFixed(0);
}

// Plotly reads a few tags in texts.
function escaped(text) {
  return text.replaceAll("&", "&amp;").replaceAll("<", "&lt;");
}

// The symmetric root of a covariance as xx, xy, xz, yy, yz, zz, or null.
function spread(t, j) {
  const at = 6 * (t * scene.joints.length + j);
  if (scene.spreads[at] === MISSING) return null;
  return Array.from(scene.spreads.subarray(at, at + 6), (number) => scene.spreadStep * number);
}

// Root mean square of the standard deviations along the axes: the trace of the root's square.
function errorBar(t, j) {
  const root = spread(t, j);
  if (!root) return null;
  const [xx, xy, xz, yy, yz, zz] = root;
  return Math.sqrt((xx * xx + yy * yy + zz * zz + 2 * (xy * xy + xz * xz + yz * yz)) / 3);
}

// The corners of an ellipsoid round its centre, and the share of each one's distance that is drawn.
function surface(root) {
  const [xx, xy, xz, yy, yz, zz] = root.map((value) => SIGMAS * value);
  return SPHERE.corners.map(([x, y, z]) => {
    const corner = [xx * x + xy * y + xz * z, xy * x + yy * y + yz * z, xz * x + yz * y + zz * z];
    const share = Math.min(1, (MOST_M * SPACE.scale) / Math.hypot(...corner));
    return [corner.map((value) => share * value), share];
  });
}

// The corners of all ellipsoids of a frame; one that is not known has all corners in one point.
function ellipsoids(t) {
  const corners = coordinates();
  for (let j = 0; j < scene.joints.length; j += 1) {
    const centre = joint(scene.refined, t, j);
    const root = centre ? spread(t, j) : null;
    const [cx, cy, cz] = centre ?? scene.origin;
    for (const [[x, y, z]] of surface(root ?? [0, 0, 0, 0, 0, 0])) push(corners, [cx + x, cy + y, cz + z]);
  }
  return corners;
}

// The triangles of so many ellipsoids: the same in every frame.
function faces(count) {
  const found = { i: [], j: [], k: [] };
  for (let one = 0; one < count; one += 1) {
    const first = one * SPHERE.corners.length;
    for (const [a, b, c] of SPHERE.faces) {
      found.i.push(first + a);
      found.j.push(first + b);
      found.k.push(first + c);
    }
  }
  return found;
}

// The unit sphere as an icosahedron whose faces are divided into four: 42 corners, 80 faces.
function sphere() {
  const g = (1 + Math.sqrt(5)) / 2;
  const corners = [
    [-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g],
    [0, -1, -g], [0, 1, -g], [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1],
  ].map(unit);
  const large = [
    [0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2],
    [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5],
    [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1],
  ];
  const known = new Map();
  const between = (a, b) => {
    const key = a < b ? `${a},${b}` : `${b},${a}`;
    if (!known.has(key)) {
      known.set(key, corners.length);
      corners.push(unit([0, 1, 2].map((axis) => corners[a][axis] + corners[b][axis])));
    }
    return known.get(key);
  };
  const small = large.flatMap(([a, b, c]) => {
    const [ab, bc, ca] = [between(a, b), between(b, c), between(c, a)];
    return [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]];
  });
  return { corners, faces: small };
}

function unit(vector) {
  const length = Math.hypot(...vector);
  return vector.map((value) => value / length);
}

// The joints of a person that are known at place `t`.
function known(pose, t, { from, to }) {
  return Array.from({ length: to - from }, (_, k) => joint(pose, t, from + k)).filter((point) => point);
}

// Middle of a person's joints at place `t`, or null.
function middle(pose, t, person) {
  const points = known(pose, t, person);
  if (!points.length) return null;
  return [0, 1, 2].map((axis) => {
    const values = points.map((point) => point[axis]).sort((a, b) => a - b);
    return values[values.length >> 1];
  });
}
