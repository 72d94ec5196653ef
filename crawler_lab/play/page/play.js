"use strict";
// The page draws what the server sends and sends what a person does; it computes nothing of the crawler.
const at = id => document.getElementById(id);
const query = new URLSearchParams(location.search);
const MOST = 1000; // ticks of the past that are drawn
const NUMBERS = { time: "s", net: "m", yaw: "rad", work: "J", dissipation: "J", jump_loss: "J" };
let socket, scene, colors, frame, past = [], hand = false, wanted = false, drag = null, queue = {}, camera = null, extent = {}, inputs = {}, touched = {};
const watch = new IntersectionObserver(rows => rows.forEach(row => { row.target.seen = row.isIntersecting; }), { rootMargin: "200px" }); // of a hundred sliders few are in view

function make(tag, properties = {}, ...children) {
  const { aria, ...rest } = properties, element = Object.assign(document.createElement(tag), rest);
  for (const [key, value] of Object.entries(aria || {})) element.setAttribute("aria-" + key, value);
  element.append(...children);
  return element;
}
const short = value => Number.isFinite(value) ? String(+value.toPrecision(6)) : "";
const ink = name => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();

// connection
function connect() {
  const name = sessionStorage.getItem("crawler_page") || "";
  socket = new WebSocket(`ws://${location.host}/live?token=${encodeURIComponent(query.get("token") || "")}&name=${encodeURIComponent(name)}`);
  socket.onmessage = event => receive(JSON.parse(event.data));
  socket.onclose = event => {
    hand = false;
    at("link").textContent = event.code === 4001 ? "opened in another window; reload to continue here" : "connection lost; trying again. If crawler play ended, start it and open the address that it prints";
    if (event.code !== 4001) setTimeout(connect, 500);
  };
}
function send(message) { if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message)); }
function receive(message) {
  if (message.scene) {
    sessionStorage.setItem("crawler_page", message.you);
    ({ scene, colors } = message);
    [frame, past, drag, queue, camera, extent, inputs, touched] = [null, [], null, {}, null, {}, {}, {}];
    build();
  } else if (message.frame) {
    if (message.fresh) past = [];
    past.push(...message.past);
    if (past.length > MOST) past.splice(0, past.length - MOST);
    frame = message;
    hand = message.hand;
    if (document.hidden) send({ seen: message.frame });
    else if (!wanted) { wanted = true; requestAnimationFrame(draw); }
    if (hand && location.hash.startsWith("#state=")) {
      send({ restore: location.hash.slice(7) });
      history.replaceState(null, "", location.pathname + location.search);
      at("error").textContent = "";
    } else if (location.hash.startsWith("#state=")) {
      at("error").textContent = "this link replaces the session as soon as you take the hand";
    }
  } else if (message.link) copy(`${location.origin}/?token=${query.get("token")}#state=${message.link}`);
  else if (message.error) at("error").textContent = message.error;
}

// controls
function build() {
  document.title = `${scene.name} - crawler play`;
  at("name").textContent = scene.name;
  at("body").className = scene.planar ? "plane" : "";
  at("net_title").textContent = scene.planar ? "Net translation along x [m]" : "Net translation [m]";
  for (const id of ["modes", "wave"]) at(id).replaceChildren(at(id).firstElementChild);
  for (const id of ["controls", "keep", "legend", "numbers", "lesson"]) at(id).replaceChildren();
  scene.modes.forEach((mode, k) => {
    const radio = make("input", { type: "radio", name: "mode", value: mode, onchange: () => act({ mode }), aria: { keyshortcuts: String(k + 1) } });
    const label = { hand: "hand", scene: "drive of the scene", wave: "wave" }[mode];
    at("modes").append(make("label", { className: "choice" }, radio, " " + label));
  });
  for (const name of ["amplitude", "mean", "wavelength", "period", "phase"]) {
    const number = make("input", { type: "number", step: "any" });
    number.onchange = () => { touched["wave " + name] = 0; act({ wave: { [name]: number.valueAsNumber } }); };
    number.oninput = () => { touched["wave " + name] = Infinity; };
    inputs["wave " + name] = [number];
    at("wave").append(make("label", { className: "control" }, make("span", { textContent: name }), make("span"), number,
      make("span", { className: "unit", textContent: { wavelength: "m", period: "s", phase: "turns" }[name] || "" })));
  }
  const groups = {};
  for (const control of scene.controls) {
    if (!groups[control.kind]) {
      const titles = { actuation: "Links", friction: "Friction", loads: "Loads", slope: "Slope" };
      groups[control.kind] = make("details", { open: control.kind !== "friction" || scene.controls.length < 16 }, make("summary", { textContent: titles[control.kind] }));
      at("controls").append(groups[control.kind]);
    }
    groups[control.kind].append(slider(control));
  }
  for (const name of scene.keeps) at("keep").append(make("button", { textContent: "Save " + name.split(".")[0], onclick: () => keep(name) }));
  at("keep").append(make("button", { textContent: "Copy link", onclick: () => send({ link: true }) }));
  at("keep").hidden = at("seeking").hidden = !scene.simulated;
  for (const id of ["step", "undo", "reset"]) at(id).hidden = !scene.simulated;
  at("lessons").hidden = !scene.lessons;
  at("lessons").replaceChildren(...[...at("lessons").children].slice(0, 2), ...Object.entries(scene.lessons || {}).map(([lesson, title]) => make("button", { textContent: title, onclick: () => act({ lesson }) })));
  at("lesson").hidden = !scene.lesson;
  if (scene.lesson) at("lesson").append(make("h2", { textContent: scene.lesson.title, tabIndex: -1 }), make("p", { textContent: scene.lesson.text }), make("ol", {}, ...scene.lesson.steps.map(step => make("li", { textContent: step }))));
  if (scene.lesson && hand) at("lesson").firstElementChild.focus();
  const words = { stick: "held", forward: scene.planar ? "slides" : "forward", back: "back", both: "both" };
  for (const [name, text] of Object.entries(words)) {
    if (scene.planar && (name === "back" || name === "both")) continue;
    const swatch = make("i", { className: "swatch" });
    swatch.style.background = colors[name];
    at("legend").append(make("span", { className: "key" }, swatch, text), " ");
  }
  for (const [name, unit] of Object.entries(NUMBERS)) {
    if (name === "yaw" ? !scene.joints.length || !scene.simulated : unit === "J" && !scene.simulated) continue; // no sensor measures them
    const value = make("dd");
    inputs["number " + name] = [value];
    at("numbers").append(make("div", {}, make("dt", { textContent: `${{ net: "net translation", jump_loss: "lost in jumps" }[name] || name} [${unit}]` }), value));
  }
}
function slider(control) {
  const { name, least, most, unit } = control;
  const range = make("input", { type: "range", min: least, max: most, step: "any", aria: { label: `${name}, slider` } });
  const number = make("input", { type: "number", step: "any", aria: { label: `${name} in ${unit}` } });
  range.oninput = () => { number.value = short(range.valueAsNumber); change(name, range.valueAsNumber); };
  range.onkeydown = event => { // with step "any" the arrow keys of browsers differ
    const steps = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 }[event.key];
    if (!steps) return;
    event.preventDefault();
    range.value = range.valueAsNumber + steps * (most - least) / 100;
    range.oninput();
  };
  number.oninput = () => { touched[name] = Infinity; };
  number.onchange = () => { if (Number.isFinite(number.valueAsNumber)) change(name, number.valueAsNumber); else touched[name] = 0; };
  inputs[name] = [range, number];
  const row = make("div", { className: "control" }, make("span", { textContent: name.replace("/", "/\u200b") }), range, number, make("span", { className: "unit", textContent: unit }));
  watch.observe(row);
  return row;
}
function change(name, value) {
  touched[name] = performance.now();
  if (!Object.keys(queue).length) requestAnimationFrame(() => { act({ set: queue }); queue = {}; });
  queue[name] = value;
}
function act(message) { at("error").textContent = ""; send(message); }
async function keep(name) {
  at("kept").textContent = `writing ${name}`;
  try {
    const answer = await fetch(`/keep/${name}?token=${encodeURIComponent(query.get("token"))}`);
    if (!answer.ok) throw Error(await answer.text());
    const file = /filename="(.*)"/.exec(answer.headers.get("Content-Disposition"))[1];
    const url = URL.createObjectURL(await answer.blob());
    make("a", { href: url, download: file }).click();
    setTimeout(() => URL.revokeObjectURL(url), 10000);
    at("kept").textContent = `saved ${file}`;
  } catch (error) { at("kept").textContent = ""; at("error").textContent = error.message.trim(); }
}
function copy(text) {
  const field = make("input", { readOnly: true, value: text, id: "address", aria: { label: "link to this state" } });
  at("kept").replaceChildren("Link to this state: ", field);
  field.select();
  if (navigator.clipboard) navigator.clipboard.writeText(text).catch(() => {});
}
const buttons = {
  play: () => act({ play: !frame.playing }), step: () => act({ step: 1 }), undo: () => act({ undo: 1 }), reset: () => act({ seek: 0 }), take: () => act({ take: 1 }),
};
for (const id in buttons) at(id).onclick = buttons[id];
at("speed").onchange = () => { touched.speed = 0; act({ speed: at("speed").valueAsNumber }); };
at("speed").oninput = () => { touched.speed = Infinity; };
at("seek").oninput = () => { touched.seek = performance.now(); act({ seek: at("seek").valueAsNumber }); };
document.onkeydown = event => {
  const typing = event.target.matches("input[type=number], input[readonly]") || event.ctrlKey || event.altKey || event.metaKey;
  if (typing || !frame || (event.key === " " && event.target.matches("button, summary, input"))) return;
  const keys = { " ": "play", ".": "step", u: "undo", r: "reset", t: "take" }, mode = scene.modes[Number(event.key) - 1];
  if (keys[event.key] && !at(keys[event.key]).hidden) buttons[keys[event.key]]();
  else if (mode) act({ mode });
  else return;
  event.preventDefault();
};

// pictures
function canvas(id) {
  const element = at(id), ratio = devicePixelRatio || 1, width = element.clientWidth, height = element.clientHeight;
  if (element.width !== Math.round(width * ratio) || element.height !== Math.round(height * ratio)) {
    element.width = Math.round(width * ratio);
    element.height = Math.round(height * ratio);
  }
  const pen = element.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  pen.font = "12px system-ui, sans-serif";
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
function dot(pen, x, y, radius, color) {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  pen.fillStyle = color;
  pen.fill();
  pen.lineWidth = 1;
  pen.strokeStyle = ink("ink");
  pen.stroke();
}
function note(pen, text, x, y) { // legible on a link and on a band
  pen.strokeStyle = ink("paper");
  pen.lineWidth = 3;
  pen.strokeText(text, x, y);
  pen.fillStyle = ink("ink");
  pen.fillText(text, x, y);
}
const shade = state => state === 2 ? colors.both : state > 0 ? colors.forward : state < 0 ? colors.back : colors.stick;
function spacing(span, most) {
  const rough = span / most, power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find(f => f * power >= rough);
}
function places() { return frame.x.map((x, i) => scene.planar ? [x[0] + scene.rest[i][0], x[1] + scene.rest[i][1]] : [x + scene.rest[i], 0]); }
function look(points, width, height) { // the camera follows in steps, so that the motion over the ground is seen
  const low = [0, 1].map(k => Math.min(...points.map(p => p[k]))), high = [0, 1].map(k => Math.max(...points.map(p => p[k])));
  const length = Math.max(high[0] - low[0], scene.planar ? high[1] - low[1] : 0, 1e-6);
  if (!camera || length > 0.8 * camera.span || length < 0.2 * camera.span) camera = { span: 2 * length, x: (low[0] + high[0]) / 2, y: (low[1] + high[1]) / 2 };
  const reach = camera.span / 2, aspect = height / width;
  for (const [k, axis, half] of [[0, "x", reach], [1, "y", scene.planar ? Math.max(reach * aspect, 1e-6) : Infinity]])
    if (low[k] < camera[axis] - half || high[k] > camera[axis] + half) camera[axis] = (low[k] + high[k]) / 2;
  const scale = scene.planar ? Math.min(width, height) / camera.span : width / camera.span;
  return { scale, to: ([x, y]) => [width / 2 + (x - camera.x) * scale, (scene.planar ? height / 2 : 0.62 * height) - (y - (scene.planar ? camera.y : 0)) * scale] };
}
function drawBody() {
  const [pen, width, height] = canvas("body"), points = places(), eye = look(points, width, height);
  pen.save();
  if (!scene.planar && frame.slope) {
    pen.translate(width / 2, 0.62 * height);
    pen.rotate(-frame.slope * Math.PI / 180);
    pen.translate(-width / 2, -0.62 * height);
  }
  drawGround(pen, width, height, eye);
  const shown = points.map(eye.to), far = Math.max(width, height);
  scene.links.forEach(([a, b], k) => {
    const slack = frame.yields[k] === -1, [p, q] = [shown[a], shown[b]];
    const bow = !scene.planar && b - a > 1 ? -14 * (b - a) : slack ? 22 : 0;
    pen.beginPath();
    pen.moveTo(...p);
    pen.quadraticCurveTo((p[0] + q[0]) / 2, (p[1] + q[1]) / 2 + bow, ...q);
    pen.strokeStyle = frame.yields[k] === 1 ? colors.stalled : slack ? colors.grey : drag && drag.link === k ? colors.actuation : ink("ink");
    pen.lineWidth = shown.length > 40 ? 2 : 4;
    pen.stroke();
  });
  const size = Math.max(2, Math.min(8, 0.3 * far / shown.length));
  shown.forEach(([x, y], i) => dot(pen, x, y, size, shade(frame.state[i])));
  if (shown.length <= 20) {
    pen.textAlign = "center";
    shown.forEach(([x, y], i) => note(pen, scene.contacts[i], x, y - size - 5));
  }
  pen.restore();
  extent.eye = eye;
  extent.points = shown;
}
function drawGround(pen, width, height, eye) {
  const left = camera.x - width / eye.scale, right = camera.x + width / eye.scale, step = spacing(width / eye.scale, 8);
  pen.textAlign = "center";
  if (scene.planar) {
    for (const [corners, color] of scene.areas) {
      pen.beginPath();
      corners.forEach((corner, k) => pen[k ? "lineTo" : "moveTo"](...eye.to(corner)));
      pen.closePath();
      pen.globalAlpha = 0.45;
      pen.fillStyle = color;
      pen.fill();
      pen.globalAlpha = 1;
    }
    for (let x = Math.ceil(left / step) * step; x < right; x += step) line(pen, [[eye.to([x, 0])[0], 0], [eye.to([x, 0])[0], height]], ink("line"));
    for (let y = Math.ceil((camera.y - height / eye.scale) / step) * step; y < camera.y + height / eye.scale; y += step) line(pen, [[0, eye.to([0, y])[1]], [width, eye.to([0, y])[1]]], ink("line"));
    pen.fillStyle = ink("dim");
    pen.fillText(`grid ${short(step)} m`, width - 60, height - 8);
    return;
  }
  const y = 0.62 * height + 9;
  for (const section of scene.sections) {
    const [start, end] = [section.start, section.end].map(x => eye.to([x, 0])[0]), each = (end - start) / section.colors.length;
    const inside = x => Math.min(Math.max(x, -width), 2 * width), [a, b] = [start, end].map(inside);
    section.colors.forEach((color, k) => { pen.fillStyle = color; pen.fillRect(inside(start + k * each), y, inside(start + (k + 1) * each) - inside(start + k * each), 16); });
    pen.fillStyle = ink("dim");
    const [from, to] = [Math.max(a, 0), Math.min(b, width)];
    if (to - from > 60) pen.fillText(section.text, (from + to) / 2, y + 52);
  }
  pen.fillStyle = colors.wall;
  for (const [at, ahead] of scene.walls) pen.fillRect(eye.to([at, 0])[0] - (ahead ? 0 : 12), y - 60, 12, 76);
  line(pen, [[-width, y], [2 * width, y]], ink("ink"), 2);
  pen.fillStyle = ink("dim");
  for (let x = Math.ceil(left / step) * step; x < right; x += step) {
    const [px] = eye.to([x, 0]);
    line(pen, [[px, y], [px, y + 6]], ink("ink"));
    pen.fillText(short(+x.toFixed(9)), px, y + 32);
  }
}
function drawHistory() {
  const [pen, width, height] = canvas("history"), count = scene.contacts.length, each = width / MOST, high = height / count;
  const shades = { f: colors.forward, b: colors.back, x: colors.both };
  pen.fillStyle = colors.stick;
  pen.fillRect(0, 0, past.length * each, height);
  for (let i = 0; i < count; i++) for (let k = 0, mark; k < past.length; k++) {
    if ((mark = past[k][2][i]) === ".") continue;
    const first = k;
    while (k + 1 < past.length && past[k + 1][2][i] === mark) k++;
    pen.fillStyle = shades[mark];
    pen.fillRect(first * each, height - (i + 1) * high, (k + 1 - first) * each + 0.3, Math.max(high - (high > 3 ? 1 : 0), 0.5));
  }
  if (count <= 20) scene.contacts.forEach((name, i) => note(pen, name, 5, height - (i + 0.5) * high + 4));
  const [plot, wide, tall] = canvas("net"), values = past.map(p => p[1]);
  if (!values.length) return;
  for (const id of ["slid", "moved"]) text(id, `in the last ${short(+(past.at(-1)[0] - past[0][0]).toFixed(2))} s`);
  const low = Math.min(...values), most = Math.max(...values), span = most - low;
  line(plot, values.map((v, k) => [k * wide / MOST, tall - 8 - (span > 1e-12 ? (v - low) / span : 0.5) * (tall - 16)]), ink("curve"), 2);
  plot.fillStyle = ink("dim");
  plot.textAlign = "right";
  plot.fillText(short(most), wide - 4, span > 1e-12 ? 14 : tall / 2 - 6);
  if (span > 1e-12) plot.fillText(short(low), wide - 4, tall - 4);
}
function fit(name, values) { // axes that only grow, so that they stay calm
  const old = extent[name] || [0, 0], low = Math.min(old[0], ...values), high = Math.max(old[1], ...values);
  return extent[name] = [low, high > low ? high : low + 1];
}
function drawTension() {
  const [pen, width, height] = canvas("tension"), count = frame.tension.length;
  at("tensions").hidden = !count;
  at("tension_title").textContent = frame.least ? "Tensions within their bounds [N]" : "Tensions [N]";
  if (!count) return;
  const [low, high] = fit("tension", [...frame.tension, ...(frame.least || []), ...(frame.most || [])]);
  const each = (width - 50) / count, px = k => 45 + (k + 0.5) * each, py = v => 12 + (high - v) / (high - low) * (height - 30);
  line(pen, [[45, py(0)], [width, py(0)]], ink("line"));
  pen.fillStyle = ink("dim");
  pen.textAlign = "right";
  pen.fillText(String(+high.toPrecision(3)), 42, 16);
  pen.fillText(String(+low.toPrecision(3)), 42, height - 14);
  frame.tension.forEach((value, k) => {
    const half = Math.min(each * 0.4, 22);
    if (frame.least) {
      pen.fillStyle = ink("line");
      pen.fillRect(px(k) - half, py(frame.most[k]), 2 * half, py(frame.least[k]) - py(frame.most[k]));
    }
    pen.fillStyle = frame.yields[k] === 1 ? colors.stalled : ink("curve");
    pen.fillRect(px(k) - half, py(value) - 1.5, 2 * half, 3);
    pen.fillStyle = ink("dim");
    pen.textAlign = "center";
    if (each > 40) pen.fillText(scene.link_names[k], px(k), height - 3);
  });
}
function drawDomain() {
  at("domains").hidden = !frame.domain;
  if (!frame.domain) return;
  const [pen, width, height] = canvas("domain"), planar = frame.domain[0].length === 2;
  const corners = frame.domain.map(c => planar ? c : [c[0], 0]), point = planar ? frame.tension : [frame.tension[0], 0];
  const [low, high] = fit("domain", [...corners.flat(), ...point]);
  const size = Math.max(high, -low) * 1.15, scale = Math.min(width, height) / 2 / size, to = ([x, y]) => [width / 2 + x * scale, height / 2 - y * scale];
  line(pen, [to([-9 * size, 0]), to([9 * size, 0])], ink("line"));
  if (planar) line(pen, [to([0, -9 * size]), to([0, 9 * size])], ink("line"));
  const edge = corners.map(to);
  if (planar) {
    pen.beginPath();
    edge.forEach(p => pen.lineTo(...p));
    pen.fillStyle = ink("band");
    pen.fill();
  }
  line(pen, [...edge, edge[0]], ink("dim"), planar ? 2 : 6);
  dot(pen, ...to(point), 6, ink("curve"));
  pen.fillStyle = ink("dim");
  pen.textAlign = "left";
  const told = (planar ? point : point.slice(0, 1)).map((value, k) => `T${k} = ${short(Math.abs(value) < 1e-9 * size ? 0 : value)}`);
  pen.fillText(`${told.join(", ")} N`, 8, 16);
}
function show(name, value, element, disabled) {
  const told = element.type === "number" ? short(value) : String(value);
  const free = performance.now() - (touched[name] ?? -1e9) > 400 && document.activeElement !== element || touched[name] === 0;
  if (free && element.value !== told) element.value = told; // to write a value costs layout, even the same one
  if (element.disabled !== disabled) element.disabled = disabled;
}
function text(id, value) { if (at(id).textContent !== value) at(id).textContent = value; }
function tell() {
  drawHistory();
  scene.controls.forEach((control, k) => {
    const [, number] = inputs[control.name];
    if (number.value && !number.parentElement.seen) return;
    const led = frame.mode === "scene" ? control.driven : frame.mode === "wave" && control.waved;
    for (const element of inputs[control.name]) show(control.name, frame.values[k], element, !hand || led);
  });
  for (const [name, value] of Object.entries(frame.wave)) show("wave " + name, value, inputs["wave " + name][0], !hand);
  for (const name in NUMBERS) if (inputs["number " + name]) {
    const value = frame[name];
    inputs["number " + name][0].parentElement.hidden = name === "jump_loss" && !value;
    inputs["number " + name][0].textContent = value == null ? "unknown" : Array.isArray(value) ? value.map(short).join(", ") : short(value);
  }
  for (const radio of at("modes").querySelectorAll("input")) { radio.checked = radio.value === frame.mode; radio.disabled = !hand; }
  at("wave").hidden = frame.mode !== "wave";
  for (const id of ["play", "step", "undo", "reset", "speed", "seek"]) at(id).disabled = !hand;
  text("play", frame.playing ? "Pause" : "Play");
  at("seek").max = frame.ticks;
  show("speed", frame.speed, at("speed"), !hand);
  show("seek", frame.tick, at("seek"), !hand);
  text("instant", `${short(frame.time)} s`);
  if (at("words").textContent !== frame.words && !(performance.now() - (draw.told || 0) < 150)) { draw.told = performance.now(); text("words", frame.words); }
  if (frame.error) text("error", frame.error);
  text("link", (hand ? "you have the hand" : "another page has the hand") + (frame.pages > 1 ? `; ${frame.pages} pages are open` : ""));
  at("take").hidden = hand;
  if (frame.console) at("console").replaceChildren(...frame.console.map(told => make("li", { textContent: told })));
}
function draw() {
  wanted = false;
  if (!frame || !scene) return;
  drawBody();
  drawTension();
  drawDomain();
  if (!frame.playing || !((window.drawn || 0) % 3)) tell(); // the history and the numbers cost most, and ten times a second is enough to read them
  window.drawn = (window.drawn || 0) + 1;
  send({ seen: frame.frame });
}

// dragging a link changes its length, dragging a joint its angle
function grab(x, y) {
  let best = null;
  const near = (distance, names, link) => { if (distance < 28 && (!best || distance < best.distance)) best = { distance, names, link }; };
  scene.joints.forEach(([, b], k) => near(Math.hypot(x - extent.points[b][0], y - extent.points[b][1]) - 10, [`joint_${k}`], -1));
  scene.links.forEach(([a, b], k) => {
    const [p, q] = [extent.points[a], extent.points[b]], length = Math.hypot(q[0] - p[0], q[1] - p[1]) || 1;
    const part = Math.min(Math.max(((x - p[0]) * (q[0] - p[0]) + (y - p[1]) * (q[1] - p[1])) / length ** 2, 0), 1);
    const name = inputs[scene.link_names[k]] ? scene.link_names[k] : scene.link_names[k] + "/x";
    if (inputs[name]) near(Math.hypot(x - p[0] - part * (q[0] - p[0]), y - p[1] - part * (q[1] - p[1])), name.endsWith("/x") ? [name, name.replace("/x", "/y")] : [name], k);
  });
  return best;
}
at("body").onpointerdown = event => {
  const found = hand && grab(event.offsetX, event.offsetY);
  if (!found || inputs[found.names[0]][0].disabled) return;
  const start = found.names.map(name => frame.values[scene.controls.findIndex(c => c.name === name)]);
  const ends = found.link >= 0 && scene.links[found.link].map(i => extent.points[i]);
  const way = ends && scene.planar ? [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]] : [1, 0], norm = Math.hypot(...way) || 1;
  drag = { ...found, start, x: event.offsetX, y: event.offsetY, way: way.map(w => w / norm) };
  at("body").setPointerCapture(event.pointerId);
};
at("body").onpointermove = event => {
  if (!drag) return;
  const dx = event.offsetX - drag.x, dy = event.offsetY - drag.y, scale = extent.eye.scale;
  if (drag.link < 0) change(drag.names[0], drag.start[0] - dy / 80);
  else if (drag.names.length === 2) { change(drag.names[0], drag.start[0] + dx / scale); change(drag.names[1], drag.start[1] - dy / scale); }
  else change(drag.names[0], drag.start[0] + (dx * drag.way[0] + dy * drag.way[1]) / scale);
};
at("body").onpointerup = at("body").onpointercancel = () => { drag = null; };
connect();
