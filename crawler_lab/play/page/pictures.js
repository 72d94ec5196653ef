"use strict";
// What is drawn of a frame; `scene`, `colors`, `frame`, `before`, `past` and `trail` are what play.js received.
const at = id => document.getElementById(id);
const MOST = 1000; // ticks of the past that are drawn
const TEETH = 14, FEW = 20, GROUND = 0.7; // of a spring; contacts with springs and names; height of the ground in the picture
let camera = null, extent = {};

const precise = value => Number.isFinite(value) ? String(+value.toPrecision(6)) : "";
const short = value => !Number.isFinite(value) ? "" : Math.abs(value) < 1e-12 ? "0" : String(+value.toPrecision(3));
const ink = name => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
function canvas(id) {
  const element = at(id), ratio = devicePixelRatio || 1, width = element.clientWidth, height = element.clientHeight;
  if (element.width !== Math.round(width * ratio) || element.height !== Math.round(height * ratio)) {
    element.width = Math.round(width * ratio);
    element.height = Math.round(height * ratio);
  }
  const pen = element.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "13px system-ui, sans-serif";
  pen.lineWidth = 1;
  return [pen, width, height];
}
function line(pen, points, color, width = 1) {
  pen.beginPath();
  points.forEach(([x, y], k) => k ? pen.lineTo(x, y) : pen.moveTo(x, y));
  pen.strokeStyle = color;
  pen.lineWidth = width;
  pen.stroke();
}
function fill(pen, points, color) {
  pen.beginPath();
  points.forEach(point => pen.lineTo(...point));
  pen.fillStyle = color;
  pen.fill();
}
function dot(pen, x, y, radius, color) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fillStyle = color;
  pen.fill();
  pen.lineWidth = 1;
  pen.strokeStyle = ink("ink");
  pen.stroke();
}
function note(pen, text, x, y) { // legible on a band
  pen.strokeStyle = ink("paper");
  pen.lineWidth = 3;
  pen.strokeText(text, x, y);
  pen.fillStyle = ink("ink");
  pen.fillText(text, x, y);
}
function arrow(pen, [x, y], [ux, uy], color) { // from 14 before a point to 14 behind it
  line(pen, [[x - 14 * ux, y - 14 * uy], [x + 5 * ux, y + 5 * uy]], color, 4);
  fill(pen, [[14, 0], [3, 7], [3, -7]].map(([a, b]) => [x + a * ux - b * uy, y + a * uy + b * ux]), color);
}
const shade = state => state === 2 ? colors.both : state > 0 ? colors.forward : state < 0 ? colors.back : colors.stick;
function spacing(span, most) {
  const rough = span / most, power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find(f => f * power >= rough);
}
function ticks(from, to, most) {
  const step = spacing(to - from, most), found = [];
  for (let k = Math.ceil(from / step); k * step <= to; k++) found.push(k * step);
  return found;
}
function places() { return frame.x.map((x, i) => scene.planar ? [x[0] + scene.rest[i][0], x[1] + scene.rest[i][1]] : [x + scene.rest[i], 0]); }
function look(points, width, height) { // the camera follows in steps, so that the motion over the ground is seen
  const low = [0, 1].map(k => Math.min(...points.map(p => p[k]))), high = [0, 1].map(k => Math.max(...points.map(p => p[k])));
  const steep = scene.planar ? 0 : Math.abs(Math.sin(frame.slope * Math.PI / 180)), unit = scene.planar ? height / width : 1;
  const length = Math.max((high[0] - low[0]) * unit, scene.planar ? high[1] - low[1] : 0, 1e-6);
  if (!camera || length > 0.9 * camera.span || length < 0.25 * camera.span) camera = { span: 1.7 * length, x: (low[0] + high[0]) / 2, y: (low[1] + high[1]) / 2 };
  const scale = scene.planar ? height / camera.span : Math.min(width, 0.9 * height / Math.max(steep, 1e-9)) / camera.span;
  for (const [k, axis, half] of [[0, "x", 0.47 * width / scale], [1, "y", scene.planar ? 0.47 * height / scale : Infinity]])
    if (low[k] < camera[axis] - half || high[k] > camera[axis] + half) camera[axis] = (low[k] + high[k]) / 2;
  const level = scene.planar ? height / 2 : GROUND * height - 14; // of the camera; on a line of the springs above the ground
  return { scale, to: ([x, y]) => [width / 2 + (x - camera.x) * scale, level - (y - (scene.planar ? camera.y : 0)) * scale] };
}
function turned([x, y], way = 1) { // of a slope, about the middle of the ground
  const [u, v] = [x - at("body").clientWidth / 2, y - GROUND * at("body").clientHeight], angle = scene.planar ? 0 : -way * frame.slope * Math.PI / 180;
  return [x - u + u * Math.cos(angle) - v * Math.sin(angle), y - v + u * Math.sin(angle) + v * Math.cos(angle)];
}

// the body
function drawBody() {
  const [pen, width, height] = canvas("body"), points = places(), eye = look(points, width, height), shown = points.map(eye.to);
  pen.save();
  if (!scene.planar && frame.slope) {
    pen.translate(width / 2, GROUND * height);
    pen.rotate(-frame.slope * Math.PI / 180);
    pen.translate(-width / 2, -GROUND * height);
  }
  (scene.planar ? drawPlane : drawTrack)(pen, width, height, eye);
  Object.assign(extent, { eye, points: shown });
  const few = shown.length <= FEW, twins = {};
  extent.springs = scene.links.map(([a, b], k) => {
    const twin = twins[[a, b]] = (twins[[a, b]] ?? -1) + 1; // springs side by side are drawn one above the other
    return drawSpring(pen, shown[a], shown[b], k, (scene.planar ? 0 : 16 * (Math.abs(b - a) - 1)) + 22 * twin);
  });
  const size = Math.max(2, Math.min(few ? 11 : 8, 0.2 * width / shown.length));
  shown.forEach(([x, y], i) => {
    dot(pen, x, y, size, shade(frame.state[i]));
    if (frame.state[i] && frame.state[i] !== 2 && shown.length <= 60 && (before || !scene.planar)) {
      const way = scene.planar ? [frame.x[i][0] - before[i][0], before[i][1] - frame.x[i][1]] : [frame.state[i], 0], norm = Math.hypot(...way);
      if (norm) arrow(pen, scene.planar ? [x + 26 * way[0] / norm, y + 26 * way[1] / norm] : [x, y - size - 12], way.map(w => w / norm), shade(frame.state[i]));
    }
  });
  if (few) {
    pen.textAlign = "center";
    pen.fillStyle = "#111";
    shown.forEach(([x, y], i) => pen.fillText(scene.contacts[i].split(" ").pop(), x, y + 4.5));
  }
  pen.restore();
}
function drawSpring(pen, p, q, k, up) { // returns its ends, where a person can grab it
  const [dx, dy] = [q[0] - p[0], q[1] - p[1]], length = Math.hypot(dx, dy) || 1, [ux, uy] = [dx / length, dy / length], wide = length > 30; // for a coil
  const put = (s, h) => [p[0] + s * dx + h * uy, p[1] + s * dy - h * ux], mark = frame.yields[k];
  const color = mark === 1 ? colors.stalled : mark === -1 ? colors.grey : drag && drag.link === k ? colors.actuation : ink("ink");
  const whole = frame.lengths[k] * extent.eye.scale / length; // its length at rest, in its own
  if (wide && whole > 0 && scene.grips[k]?.[0].length) {
    const ends = [(1 - whole) / 2, (1 + whole) / 2], high = up + (scene.planar ? 16 : 40 + 8 * (k % 2));
    line(pen, ends.map(s => put(s, high)), colors.actuation, 2);
    for (const s of ends) line(pen, [put(s, high - 5), put(s, high + 5)], colors.actuation, 2);
  }
  const sag = mark === -1 ? -11 : 0, curve = s => up + 4 * (sag + (up ? 6 : 0)) * s * (1 - s), coil = wide && mark !== -1 && (!scene.grips[k] || scene.grips[k][0].length);
  const course = [[0, 0], [0.12, coil ? up : curve(0.12)]];
  for (let j = 0; j < TEETH; j++) course.push([0.12 + 0.76 * (j + 0.5) / TEETH, coil ? up + (j % 2 ? -8 : 8) : curve(0.12 + 0.76 * (j + 0.5) / TEETH)]);
  line(pen, [...course, [0.88, coil ? up : curve(0.88)], [1, 0]].map(([s, h]) => put(s, h)), color, coil ? 1.8 : wide ? 4 : 2);
  return [put(0, up), put(1, up)];
}
function drawPlane(pen, width, height, eye) {
  for (const [corners, color] of scene.areas) {
    pen.globalAlpha = 0.45;
    fill(pen, corners.map(eye.to), color);
    pen.globalAlpha = 1;
  }
  pen.fillStyle = ink("dim");
  pen.textAlign = "left";
  const half = [width / 2 / eye.scale, height / 2 / eye.scale];
  for (const x of ticks(camera.x - half[0], camera.x + half[0], 10)) {
    line(pen, [[eye.to([x, 0])[0], 0], [eye.to([x, 0])[0], height]], ink("line"));
    pen.fillText(short(x), eye.to([x, 0])[0] + 3, height - 5);
  }
  for (const y of ticks(camera.y - half[1], camera.y + half[1], 5)) {
    line(pen, [[0, eye.to([0, y])[1]], [width, eye.to([0, y])[1]]], ink("line"));
    if (eye.to([0, y])[1] > 18) pen.fillText(`${short(y)} m`, 4, eye.to([0, y])[1] - 4);
  }
  const course = past.map(p => eye.to([p[1][0] + scene.middle[0], p[1][1] + scene.middle[1]])), now = eye.to(frame.net.map((n, k) => n + scene.middle[k]));
  line(pen, [...course, now], ink("curve"), 2.5);
  if (scene.joints.length && frame.yaw != null) arrow(pen, now, [Math.cos(frame.yaw), -Math.sin(frame.yaw)], ink("curve"));
  else line(pen, [[now[0] - 7, now[1]], [now[0] + 7, now[1]], now, [now[0], now[1] - 7], [now[0], now[1] + 7]], ink("curve"), 2.5);
}
function drawTrack(pen, width, height, eye) {
  const y = GROUND * height;
  for (const section of scene.sections) {
    const [start, end] = [section.start, section.end].map(x => eye.to([x, 0])[0]), each = (end - start) / section.colors.length;
    const inside = x => Math.min(Math.max(x, -width), 2 * width), [a, b] = [start, end].map(inside);
    section.colors.forEach((color, k) => { pen.fillStyle = color; pen.fillRect(inside(start + k * each), y, inside(start + (k + 1) * each) - inside(start + k * each), 16); });
    pen.fillStyle = ink("dim");
    pen.textAlign = "center";
    const [from, to] = [Math.max(a, 0), Math.min(b, width)];
    if (to - from > 60) pen.fillText(section.text, (from + to) / 2, y + 46);
  }
  pen.fillStyle = colors.wall;
  for (const [at, ahead] of scene.walls) pen.fillRect(eye.to([at, 0])[0] - (ahead ? 0 : 12), y - 60, 12, 76);
  line(pen, [[-width, y], [2 * width, y]], ink("ink"), 2);
  const [home] = eye.to([scene.rest[0], 0]);
  line(pen, [[home, y], [home, y - 0.55 * height]], ink("line"), 2);
  pen.fillStyle = ink("dim");
  pen.textAlign = "left";
  if (home >= 0) pen.fillText("start", home + 4, y - 0.5 * height);
  pen.textAlign = "center";
  const marks = ticks(camera.x - width / eye.scale, camera.x + width / eye.scale, 16);
  for (const x of marks) {
    const [px] = eye.to([x, 0]);
    line(pen, [[px, y], [px, y + 6]], ink("ink"));
    if (frame.slope || px > 30 && px < width - 30) pen.fillText(`${short(x)}${x === marks.at(-1) || Math.abs(x) < 1e-12 ? " m" : ""}`, px, y + 28);
  }
}

// what happened, and what is possible
function drawHistory() {
  const [pen, width, height] = canvas("history"), count = scene.contacts.length, high = height / count;
  const shades = { f: colors.forward, b: colors.back, x: colors.both }, each = width / Math.max(past.length, MOST / 5);
  pen.fillStyle = colors.stick;
  pen.fillRect(0, 0, past.length * each, height);
  for (let i = 0; i < count; i++) for (let k = 0, mark; k < past.length; k++) {
    if ((mark = past[k][2][i]) === ".") continue;
    const first = k;
    while (k + 1 < past.length && past[k + 1][2][i] === mark) k++;
    pen.fillStyle = shades[mark];
    pen.fillRect(first * each, height - (i + 1) * high, (k + 1 - first) * each + 0.3, Math.max(high - (high > 4 ? 1 : 0), 0.5));
  }
  if (count <= 10) scene.contacts.forEach((name, i) => note(pen, name, 5, height - (i + 0.5) * high + 4));
  const [plot, wide, tall] = canvas("net"), values = scene.planar ? past.flatMap(p => p[1]) : past.map(p => p[1][0]);
  if (!past.length) return;
  const span = `in the last ${short(past.at(-1)[0] - past[0][0])} s`;
  text("moved", span);
  text("slid", span + (past.some(p => p[2].includes("x")) ? "; black: to and fro in a tick" : ""));
  const low = Math.min(...values), most = Math.max(...values), range = most - low, py = v => tall - 8 - (range > 1e-12 ? (v - low) / range : 0.5) * (tall - 16);
  if (low < 0 && most > 0) line(plot, [[0, py(0)], [wide, py(0)]], ink("line"));
  for (const axis of frame.net.keys()) line(plot, past.map((p, k) => [k * wide / Math.max(past.length, MOST / 5), py(p[1][axis])]), ink(axis ? "dim" : "curve"), 2);
  plot.textAlign = "right";
  note(plot, short(most), wide - 4, range > 1e-12 ? 14 : tall / 2 - 6);
  if (range > 1e-12) note(plot, short(low), wide - 4, tall - 4);
}
function fit(name, values) { // axes that only grow, so that they stay calm
  const old = extent[name] || [0, 0], low = Math.min(old[0], ...values), high = Math.max(old[1], ...values);
  extent[name] = [low, high];
  return [low, high > low ? high : low + 1];
}
function drawTension() {
  const count = frame.tension.length;
  at("tensions").hidden = !count || frame.domain?.[0].length === 1; // of two feet, the interval shows it
  if (at("tensions").hidden) return;
  const [pen, width, height] = canvas("tension");
  text("tension_title", frame.least ? "Tensions within their bounds [N]" : "Tensions [N]");
  const [low, high] = fit("tension", [...frame.tension, ...(frame.least || []), ...(frame.most || [])]);
  const each = (width - 60) / count, px = k => 56 + (k + 0.5) * each, py = v => 12 + (high - v) / (high - low) * (height - 34);
  line(pen, [[56, py(0)], [width, py(0)]], ink("line"));
  pen.fillStyle = ink("dim");
  pen.textAlign = "right";
  for (const [end, y] of [[high, 16], [low, height - 18]]) pen.fillText(String(+end.toPrecision(2)), 52, y);
  frame.tension.forEach((value, k) => {
    const half = Math.min(each * 0.4, 22);
    if (frame.least) {
      pen.fillStyle = ink("line");
      pen.fillRect(px(k) - half, py(frame.most[k]), 2 * half, py(frame.least[k]) - py(frame.most[k]));
    }
    pen.fillStyle = frame.yields[k] === 1 ? colors.stalled : ink("curve");
    const root = frame.least ? value : 0; // a mark within bounds, without them a bar
    pen.fillRect(px(k) - half, Math.min(py(value), py(root)) - 1.5, 2 * half, Math.abs(py(value) - py(root)) + 3);
    pen.fillStyle = ink("dim");
    pen.textAlign = "center";
    if (each > 46) pen.fillText(scene.link_names[k], px(k), height - 4);
  });
}
function drawDomain() {
  at("domains").hidden = !frame.domain;
  if (!frame.domain) return;
  const [pen, width, height] = canvas("domain"), planar = frame.domain[0].length === 2, flat = p => planar ? p : [p[0], 0];
  const [low, high] = fit("domain", [...frame.domain.flat(), ...frame.tension]), size = Math.max(high, -low) * (planar ? 1.3 : 1.15);
  const scale = (planar ? Math.min(width, height) : width) / 2 / size, to = p => [width / 2 + flat(p)[0] * scale, height / 2 - flat(p)[1] * scale];
  line(pen, [[0, height / 2], [width, height / 2]], ink("line"));
  if (planar) line(pen, [[width / 2, 0], [width / 2, height]], ink("line"));
  fill(pen, frame.domain.map(to), ink("band"));
  line(pen, [...frame.domain, frame.domain[0]].map(to), ink("dim"), planar ? 1.5 : 8);
  for (const value of ticks(-width / 2 / scale, width / 2 / scale, planar ? 10 : 8)) {
    const [x, y] = [width / 2 + value * scale, height / 2 - value * scale];
    line(pen, [[x, height / 2 - 3], [x, height / 2 + 3]], ink("dim"));
    pen.textAlign = "center";
    if (Math.abs(x - width / 2) > 12 && x > 20 && x < width - 20) note(pen, short(value), x, height / 2 + (planar ? 17 : 30));
    if (!planar || y < 12 || y > height - 12) continue;
    line(pen, [[width / 2 - 3, y], [width / 2 + 3, y]], ink("dim"));
    pen.textAlign = "left";
    if (Math.abs(value) > 1e-12) note(pen, short(value), width / 2 + 6, y + 4);
  }
  for (const [direction, foot, a, b] of frame.sides) {
    const [p, q] = [to(a), to(b)], middle = [(p[0] + q[0]) / 2, (p[1] + q[1]) / 2], away = Math.hypot(middle[0] - width / 2, middle[1] - height / 2) || 1;
    line(pen, planar ? [p, q] : [[p[0], p[1] - 14], [p[0], p[1] + 14]], shade(direction), 5);
    pen.textAlign = planar && middle[0] > width / 2 ? "left" : planar ? "right" : "center";
    if (Math.hypot(q[0] - p[0], q[1] - p[1]) > 24 || !planar) note(pen, `foot ${foot}`, middle[0] + 9 * (middle[0] - width / 2) / away, planar ? middle[1] + 4 + 14 * (middle[1] - height / 2) / away : middle[1] - 20);
  }
  if (planar) line(pen, trail.map(to), ink("curve"), 1.5);
  dot(pen, ...to(frame.tension), 6, ink("curve"));
  pen.fillStyle = ink("dim");
  pen.textAlign = "right";
  pen.fillText(`${scene.link_names[0]} → ${short(frame.tension[0])} N`, width - 8, height - 8);
  pen.textAlign = "left";
  if (planar) pen.fillText(`${scene.link_names[1]} ↑ ${short(frame.tension[1])} N`, 8, 16);
}
