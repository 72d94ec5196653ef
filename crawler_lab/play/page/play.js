// The page draws what the server sends and sends what a person does; it computes nothing of the crawler.
const query = new URLSearchParams(location.search);
const TRAIL = 60; // frames after which the trail of the tensions ends
const NUMBERS = { time: "s", net: "m", heading: "°", work: "J", dissipation: "J", stored: "J", jump_loss: "J" };
const LABELS = { net: "net translation", jump_loss: "lost in jumps", stored: "in springs" };
let socket, scene, colors, frame, before, past = [], trail = [], hand = false, wanted = false, drag = null, queue = {}, inputs = {}, touched = {};
let acted = false, opening = null; // whether a person has done something; until when the page plays by itself [s]
const watch = new IntersectionObserver(rows => rows.forEach(row => { row.target.seen = row.isIntersecting; }), { rootMargin: "200px" }); // of a hundred sliders few are in view

function make(tag, properties = {}, ...children) {
  const { aria, ...rest } = properties, element = Object.assign(document.createElement(tag), rest);
  for (const [key, value] of Object.entries(aria || {})) element.setAttribute("aria-" + key, value);
  element.append(...children);
  return element;
}

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
    [frame, before, past, trail, drag, queue, camera, extent, inputs, touched, acted, opening] = [null, null, [], [], null, {}, null, {}, {}, {}, false, null];
    build();
  } else if (message.frame) {
    if (message.fresh) [past, trail] = [[], []];
    past.push(...message.past);
    past = past.slice(-MOST);
    trail = [...trail.slice(1 - TRAIL), message.tension];
    if (frame && frame.time !== message.time) before = message.time > frame.time ? frame.x : null; // arrows along the motion
    frame = message;
    hand = message.hand;
    if (document.hidden) send({ seen: message.frame });
    else if (!wanted) { wanted = true; requestAnimationFrame(draw); }
    open();
  } else if (message.link) copy(`${location.origin}/?token=${query.get("token")}#state=${message.link}`);
  else if (message.error) at("error").textContent = message.error;
}
function open() { // a link restores its session; otherwise a first period is played, unless the person prefers less motion
  const link = location.hash.startsWith("#state=");
  if (hand && link) {
    send({ restore: location.hash.slice(7) });
    history.replaceState(null, "", location.pathname + location.search);
    at("error").textContent = "";
  } else if (link) at("error").textContent = "this link replaces the session as soon as you take control";
  if (opening === null) {
    opening = hand && !link && !frame.ticks && frame.mode === "scene" && !matchMedia("(prefers-reduced-motion: reduce)").matches ? scene.period : 0;
    if (opening) send({ play: true });
  } else if (opening && !acted && frame.time >= opening) { opening = 0; send({ play: false }); }
}

// controls
function build() {
  document.title = `${scene.name} - crawler play`;
  at("name").textContent = scene.name;
  at("main").className = scene.planar ? "plane" : "";
  at("net_title").textContent = scene.planar ? "Net translation along x, grey along y [m]" : "Net translation [m]";
  for (const id of ["modes", "wave"]) at(id).replaceChildren(at(id).firstElementChild);
  for (const id of ["controls", "legend", "numbers", "lesson", "kept"]) at(id).replaceChildren();
  scene.modes.forEach((mode, k) => {
    const radio = make("input", { type: "radio", name: "mode", value: mode, onchange: () => act({ mode }), aria: { keyshortcuts: String(k + 1) } });
    at("modes").append(make("label", { className: "choice" }, radio, " " + { hand: "you", scene: "its drive", wave: "a wave" }[mode]));
  });
  for (const name of ["amplitude", "mean", "wavelength", "period", "phase"]) {
    const number = make("input", { type: "number", step: "any" });
    number.onchange = () => { touched["wave " + name] = 0; act({ wave: { [name]: number.valueAsNumber } }); };
    number.oninput = () => { touched["wave " + name] = Infinity; };
    inputs["wave " + name] = [number];
    at("wave").append(make("label", { className: "control" }, make("span", { textContent: name }), make("span"), number,
      make("span", { className: "unit", textContent: { wavelength: "m", period: "s", phase: "turns" }[name] || "" })));
  }
  const driven = scene.controls.some(control => control.kind === "actuation" && control.driven);
  const titles = { actuation: scene.joints.length ? "Links and joints" : "Links", passive: "Passive: its drive does not move these", friction: "Friction", loads: "Loads", slope: "Slope" };
  for (const kind in titles) {
    const own = scene.controls.filter(control => kind === (control.kind === "actuation" && driven && !control.driven ? "passive" : control.kind));
    const open = kind !== "passive" && (kind !== "friction" || scene.controls.length < 16);
    if (own.length) at("controls").append(make("details", { open }, make("summary", { textContent: titles[kind] }), ...own.map(slider)));
  }
  const saved = scene.keeps.map(name => make("button", { textContent: "Save " + name.split(".")[0], onclick: () => keep(name) }));
  at("keep").lastElementChild.replaceChildren(...saved, make("button", { textContent: "Copy link", onclick: () => send({ link: true }) }));
  for (const id of ["keep", "seeking", "step", "undo", "reset"]) at(id).hidden = !scene.simulated;
  at("lessons").hidden = !scene.lessons;
  const lessons = Object.entries(scene.lessons || {}).map(([lesson, title]) => make("button", { textContent: title, onclick: () => act({ lesson }) }));
  at("lessons").lastElementChild.replaceChildren(at("lessons").querySelector("p"), ...lessons);
  at("lesson").hidden = !scene.lesson;
  if (scene.lesson) teach(scene.lesson);
  const words = scene.planar ? { stick: "held", forward: "slides" } : { stick: "held", forward: "forward", back: "back" };
  if (scene.contacts.length <= 2 * FEW && scene.link_names.some((name, k) => name.startsWith("link") && scene.grips[k][0].length)) words.actuation = "length at rest";
  for (const [name, told] of Object.entries(words)) {
    const swatch = make("i", { className: "swatch" });
    swatch.style.background = colors[name];
    at("legend").append(make("span", { className: "key" }, swatch, told), " ");
  }
  for (const [name, unit] of Object.entries(NUMBERS)) {
    if (name === "heading" ? !scene.joints.length || !scene.simulated : unit === "J" && !scene.simulated) continue; // no sensor measures them
    const value = make("dd");
    inputs["number " + name] = [value];
    at("numbers").append(make("div", {}, make("dt", { textContent: `${LABELS[name] || name} [${unit}]` }), value));
  }
}
function teach(lesson) { // one step at a time, beside the sliders
  const steps = lesson.steps.map((step, k) => make("li", { textContent: step, value: k + 1 }));
  const go = way => {
    const now = Math.min(Math.max(steps.findIndex(step => step.className) + way, 0), steps.length - 1);
    steps.forEach((step, k) => { step.className = k === now ? "now" : ""; });
    [last.disabled, next.disabled] = [!now, now === steps.length - 1];
  };
  const [last, next] = [["Last step", -1], ["Next step", 1]].map(([textContent, way]) => make("button", { textContent, onclick: () => go(way) }));
  at("lesson").append(make("h2", { textContent: lesson.title, tabIndex: -1 }), make("p", { textContent: lesson.text }), make("ol", {}, ...steps), make("div", { className: "row" }, last, next));
  go(1);
  at("lessons").open = false;
  if (hand) at("lesson").firstElementChild.focus();
}
function slider(control) {
  const { name, title, least, most, unit } = control;
  const range = make("input", { type: "range", min: least, max: most, step: "any", aria: { label: `${title}, slider` } });
  const number = make("input", { type: "number", step: "any", aria: { label: `${title} in ${unit}` } });
  range.oninput = () => { number.value = precise(range.valueAsNumber); change(name, range.valueAsNumber); };
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
  const row = make("div", { className: "control", title: name }, make("span", { textContent: title }), range, number, make("span", { className: "unit", textContent: unit }));
  watch.observe(row);
  return row;
}
const led = control => frame.mode === "scene" ? control.driven : frame.mode === "wave" && control.waved;
function takeOver(names) { return scene.controls.some(control => names.includes(control.name) && led(control)) ? { mode: "hand" } : {}; }
function change(name, value) { // of what the drive or the wave moves, a person takes over
  touched[name] = performance.now();
  if (!Object.keys(queue).length) requestAnimationFrame(() => { act({ ...takeOver(Object.keys(queue)), set: queue }); queue = {}; });
  queue[name] = value;
}
function act(message) { acted = true; at("error").textContent = ""; send(message); }
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

// frames
function show(name, value, element, disabled, write = precise) {
  const told = element.type === "number" ? write(value) : String(value);
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
    for (const element of inputs[control.name]) show(control.name, frame.values[k], element, !hand, led(control) ? short : precise);
  });
  for (const [name, value] of Object.entries(frame.wave)) show("wave " + name, value, inputs["wave " + name][0], !hand);
  for (const name in NUMBERS) if (inputs["number " + name]) {
    const value = name === "heading" ? frame.yaw * 180 / Math.PI : frame[name];
    inputs["number " + name][0].parentElement.hidden = name === "jump_loss" && !value;
    inputs["number " + name][0].textContent = value == null ? "unknown" : Array.isArray(value) ? value.map(short).join(", ") : name === "time" ? value.toFixed(2) : short(value);
  }
  for (const radio of at("modes").querySelectorAll("input")) { radio.checked = radio.value === frame.mode; radio.disabled = !hand; }
  at("wave").hidden = frame.mode !== "wave";
  for (const id of ["play", "step", "undo", "reset", "speed", "seek"]) at(id).disabled = !hand;
  text("play", frame.playing ? "Pause" : "Play");
  at("seek").max = frame.ticks;
  show("speed", frame.speed, at("speed"), !hand);
  show("seek", frame.tick, at("seek"), !hand);
  text("instant", `${frame.time.toFixed(2)} s`);
  if (frame.error) text("error", frame.error);
  text("link", (hand ? "you control it" : "another page controls it") + (frame.pages > 1 ? `; ${frame.pages} pages are open` : ""));
  at("take").hidden = hand;
  if (frame.console) at("console").replaceChildren(...frame.console.map(told => make("li", { textContent: told })));
}
function invite() { // until a person has done something; and what a drag does
  const what = scene.grips.some(([names]) => names.length) ? "drag a link" : "drag a joint up or down";
  if (drag) return drag.names.map(name => scene.controls.findIndex(c => c.name === name)).map(k => `${scene.controls[k].title}: ${short(frame.values[k])} ${scene.controls[k].unit}`).join(", ");
  if (acted || !hand || scene.lesson || !scene.simulated) return "";
  return frame.playing ? `Its drive moves it: ${what} to take over` : frame.mode === "scene" ? `▶ Play, or ${what}` : `Move it: ${what}`;
}
function draw() {
  wanted = false;
  if (!frame || !scene) return;
  drawBody();
  drawTension();
  drawDomain();
  at("words").ariaLive = frame.playing ? "off" : "polite"; // a screen reader cannot follow what plays
  text("words", frame.words);
  text("hint", invite());
  if (!frame.playing || !((window.drawn || 0) % 3)) tell(); // the history and the numbers cost most, and ten times a second is enough to read them
  window.drawn = (window.drawn || 0) + 1;
  send({ seen: frame.frame });
}

// dragging a link changes its length, dragging a joint its angle
function grab([x, y]) {
  let best = null;
  const near = (distance, names, link) => { if (distance < 28 && (!best || distance < best.distance)) best = { distance, names, link }; };
  scene.joints.forEach(([, b], k) => near(Math.hypot(x - extent.points[b][0], y - extent.points[b][1]) - 10, [`joint_${k}`], -1));
  extent.springs.forEach(([p, q], k) => {
    const length = Math.hypot(q[0] - p[0], q[1] - p[1]) || 1, names = scene.grips[k]?.[0] || [];
    const part = Math.min(Math.max(((x - p[0]) * (q[0] - p[0]) + (y - p[1]) * (q[1] - p[1])) / length ** 2, 0), 1);
    if (names.length) near(Math.hypot(x - p[0] - part * (q[0] - p[0]), y - p[1] - part * (q[1] - p[1])), names, k);
  });
  return best;
}
at("body").onpointerdown = event => {
  const place = turned([event.offsetX, event.offsetY], -1), found = frame && grab(place);
  if (!found) return;
  if (!hand) { text("error", "another page controls it: take control first"); return; }
  const over = takeOver(found.names);
  if (over.mode) act(over);
  const start = found.names.map(name => frame.values[scene.controls.findIndex(c => c.name === name)]);
  const [a, b] = found.link < 0 ? [[0, 0], [1, 0]] : extent.springs[found.link], way = [b[0] - a[0], b[1] - a[1]], norm = Math.hypot(...way) || 1;
  drag = { ...found, start, from: place, way: scene.planar ? way.map(w => w / norm) : [1, 0] };
  at("body").setPointerCapture(event.pointerId);
};
at("body").onpointermove = event => {
  const place = turned([event.offsetX, event.offsetY], -1);
  if (!drag) { at("body").style.cursor = frame && hand && grab(place) ? "grab" : ""; return; }
  const [dx, dy] = place.map((p, k) => p - drag.from[k]), metres = extent.eye.scale * (drag.link < 0 ? 1 : scene.grips[drag.link][1]);
  if (drag.link < 0) change(drag.names[0], drag.start[0] - dy / 80);
  else if (drag.names.length === 2) { change(drag.names[0], drag.start[0] + dx / metres); change(drag.names[1], drag.start[1] - dy / metres); }
  else change(drag.names[0], drag.start[0] + (dx * drag.way[0] + dy * drag.way[1]) / metres);
};
at("body").onpointerup = at("body").onpointercancel = () => { drag = null; };
connect();
