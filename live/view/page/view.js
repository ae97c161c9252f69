// Page of the live view: shows frames and states, sends requests. Messages: live/view/requests.py.
import { Curves } from "./curves.js";
import { Gamepads } from "./gamepads.js";

const at = (id) => document.getElementById(id);
const RANGES = { forward: [-1, 1.5], left: [-0.8, 0.8], turn: [-1.2, 1.2] };
const STEPS = { forward: 0.1, left: 0.1, turn: 0.2 };
const SETTLING = 400; // ms after an input in which the reported state does not overwrite it
const MAX_EVENTS = 12;

const command = { forward: 0, left: 0, turn: 0 };
const curves = new Curves(at);
let socket = null;
let axes = [];
let latest = null; // the latest state
let decoding = 0; // frames received but not shown yet
let frame_times = []; // times of the frames shown in the last second, ms
let last_input = 0; // time of the last input, ms

function send(action, values = {}) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ do: action, ...values }));
}

function connect() {
  const address = new URL("socket", location.href);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    notice("");
    socket.send("hello");
  };
  socket.onclose = () => {
    notice("not connected: is `python -m quad_env view` still running? trying again …");
    setTimeout(connect, 1000);
  };
  socket.onmessage = ({ data }) => (typeof data === "string" ? handle_message(JSON.parse(data)) : show(data));
}

const acknowledge_frame = () => socket?.readyState === WebSocket.OPEN && socket.send("drawn");

// Show a frame. One more frame may arrive while it is decoded, and the next one after it is shown.
async function show(file) {
  const first = decoding === 0;
  decoding += 1;
  if (first) acknowledge_frame();
  const canvas = at("frame");
  const picture = await createImageBitmap(new Blob([file], { type: "image/jpeg" }));
  if (canvas.width !== picture.width || canvas.height !== picture.height) {
    canvas.width = picture.width;
    canvas.height = picture.height;
  }
  canvas.getContext("2d").drawImage(picture, 0, 0);
  picture.close();
  frame_times = [...frame_times.filter((time) => time > performance.now() - 1000), performance.now()];
  canvas.dataset.frames = Number(canvas.dataset.frames ?? 0) + 1;
  decoding -= 1;
  if (!first) acknowledge_frame();
}

function handle_message(message) {
  if (message.kind === "offer") show_choices(message);
  if (message.kind === "state") show_state(message);
  if (message.kind === "error") add_event(message.text, "bad");
}

function show_choices({ robot, policies, axes: offeredAxes }) {
  document.title = `SimpleQuad: ${robot}`;
  axes = offeredAxes;
  for (const select of [at("policy-0"), at("policy-1")]) select.replaceChildren(...policies.map((name) => new Option(name)));
  at("policy-1").prepend(new Option("none", ""));
  at("scenario").replaceChildren(new Option("flat"), ...axes.map(({ name }) => new Option(name)).filter((o) => o.value !== "flat"));
  set_severity_slider();
  if (latest) show_scenario(latest.scenario);
}

const chosen_axis = () => axes.find(({ name }) => name === at("scenario").value);

// Set the slider of the chosen axis's severity, from its mildest to its hardest level.
function set_severity_slider(value) {
  const axis = chosen_axis();
  at("severity-label").hidden = !axis || axis.levels.length < 2;
  if (!axis) return;
  const slider = at("severity");
  slider.min = Math.min(...axis.levels);
  slider.max = Math.max(...axis.levels);
  slider.value = value ?? axis.nominal;
  show_severity_value();
}

function show_severity_value() {
  at("severity-value").textContent = `${Number(at("severity").value).toPrecision(3)} ${chosen_axis().unit}`;
}

// Select the axis and severity of a scenario's name: rough, rough:3, rough=0.12; other names change nothing.
function show_scenario(scenario) {
  const [, name, sign, value] = scenario.match(/^(\w+)(?:([:=])([\d.e-]+))?$/) ?? [];
  const axis = axes.find((candidate) => candidate.name === name);
  if (!axis && name !== "flat") return;
  at("scenario").value = name;
  set_severity_slider(sign === ":" ? axis.levels[value - 1] : sign === "=" ? Number(value) : undefined);
}

function choose_scenario() {
  const name = at("scenario").value;
  const axis = chosen_axis();
  send("scenario", { name: axis && axis.levels.length > 1 ? `${name}=${Number(Number(at("severity").value).toPrecision(3))}` : name });
}

function show_state(state) {
  const first = !latest;
  if (latest?.scenario !== state.scenario) show_scenario(state.scenario);
  latest = state;
  const has_settled = performance.now() - last_input > SETTLING;
  if (has_settled || first) {
    [command.forward, command.left, command.turn] = state.command;
    show_command();
    at("follow").checked = state.follow;
    at("speed").value = Math.round(Math.log2(state.speed));
    for (const number of [0, 1]) name_policy(at(`policy-${number}`), state.robots[number]?.policy ?? "");
  }
  at("pause").textContent = state.paused ? "go on" : "pause";
  at("speed-value").textContent = `${state.speed} ×`;
  at("clock").textContent = `${state.time.toFixed(2)} s, ${state.scenario}, seed ${state.seed}, commands ${state.by_hand ? "by hand" : "of the scenario"}${state.paused ? ", paused" : ""}`;
  at("rate").textContent = `${state.measured.toFixed(2)} × real time, ${frame_times.filter((time) => time > performance.now() - 1000).length} frames/s`;
  if (state.drawing) notice(state.drawing);
  show_outcomes(state);
  show_table(state);
  curves.add(state.robots);
  for (const event of state.events) add_event(event);
}

function name_policy(select, name) {
  if (document.activeElement === select) return;
  if (![...select.options].some(({ value }) => value === name)) select.add(new Option(name));
  select.value = name;
}

function element(tag, text, kind = "") {
  const node = document.createElement(tag);
  node.textContent = text;
  node.className = kind;
  return node;
}

// Outcome of each robot with the events that led to it; it stays until the next episode.
function show_outcomes({ robots }) {
  const parts = robots.map(({ policy, outcome, failed, story }, number) => {
    const part = element("p", `${policy}: `, `robot-${number}`);
    part.append(element("span", outcome, failed ? "bad" : "known"), ...story.map((line) => element("small", line)));
    return part;
  });
  if (parts.map((part) => part.textContent).join() !== at("outcomes").dataset.shown) at("outcomes").replaceChildren(...parts);
  at("outcomes").dataset.shown = parts.map((part) => part.textContent).join();
  at("legend").replaceChildren(at("legend").firstChild, at("legend").firstElementChild, ...robots.map(({ policy }, number) => element("b", `, ${policy}`, `robot-${number}`)));
}

const HEADS = ["robot", "forward, m/s", "left, m/s", "turning, rad/s", "x, m", "y, m", "heading, °", "height, m", "tilt, °", "torque, % of the limit", "correction, % of the authority"];

function show_table({ robots }) {
  const percent = (value) => (value === null ? "–" : Math.round(100 * value));
  const rows = robots.map(({ policy, velocity, position, heading, height, tilt, torque, correction }, number) => {
    const figures = [...velocity, position[0], position[1]].map((value) => value.toFixed(2));
    const cells = [policy, ...figures, heading.toFixed(0), height.toFixed(2), tilt.toFixed(0), percent(torque), percent(correction)];
    const row = element("tr", "", `robot-${number}`);
    row.append(...cells.map((text) => element("td", text)));
    [...row.cells].forEach((cell, column) => (cell.dataset.name = HEADS[column]));
    return row;
  });
  const head = element("tr", "");
  head.append(...HEADS.map((text) => element("th", text)));
  at("robots").replaceChildren(head, ...rows);
}

function add_event(text, kind = "") {
  at("events").prepend(element("li", text, kind));
  while (at("events").childElementCount > MAX_EVENTS) at("events").lastElementChild.remove();
}

function notice(text) {
  at("notice").textContent = text;
}

function show_command() {
  for (const [name, value] of Object.entries(command)) {
    at(`${name}-slider`).value = value;
    at(`${name}-value`).textContent = value.toFixed(2);
  }
}

function steer(changes) {
  for (const [name, value] of Object.entries(changes)) {
    const [low, high] = RANGES[name];
    command[name] = Math.min(high, Math.max(low, Math.round(100 * value) / 100));
  }
  last_input = performance.now();
  show_command();
  send("steer", command);
}

const halt = () => steer({ forward: 0, left: 0, turn: 0 });
const push = () => send("push", { direction: Number(at("direction").value), impulse: Number(at("impulse").value) });
const pause = () => send("pause", { on: !latest?.paused });
const restart = () => send("reset", { seed: latest?.seed ?? 0 });
const follow = () => send("follow", { on: !latest?.follow });

const KEYS = {
  ArrowUp: () => steer({ forward: command.forward + STEPS.forward }),
  ArrowDown: () => steer({ forward: command.forward - STEPS.forward }),
  w: () => steer({ forward: command.forward + STEPS.forward }),
  s: () => steer({ forward: command.forward - STEPS.forward }),
  ArrowLeft: () => steer({ turn: command.turn + STEPS.turn }),
  ArrowRight: () => steer({ turn: command.turn - STEPS.turn }),
  a: () => steer({ left: command.left + STEPS.left }),
  d: () => steer({ left: command.left - STEPS.left }),
  " ": halt,
  x: push,
  p: pause,
  ".": () => send("step"),
  r: restart,
  n: () => send("next"),
  f: follow,
};

addEventListener("keydown", (event) => {
  const { tagName, type } = event.target;
  const control_uses_key = type === "text" || tagName === "SELECT" || (type === "range" && event.key.startsWith("Arrow"));
  if (control_uses_key || event.ctrlKey || event.altKey || event.metaKey) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (!(key in KEYS)) return;
  event.preventDefault();
  KEYS[key]();
});

for (const name of Object.keys(command)) at(`${name}-slider`).oninput = ({ target }) => steer({ [name]: Number(target.value) });
for (const [id, unit] of [["direction", "°"], ["impulse", " N·s"]]) {
  const show_value = () => (at(`${id}-value`).textContent = at(id).value + unit);
  at(id).oninput = show_value;
  show_value();
}
for (const number of [0, 1]) {
  at(`policy-${number}`).onchange = ({ target: { value } }) => (value ? send("policy", { robot: number, name: value }) : send("alone"));
}
at("follow").onchange = ({ target }) => {
  last_input = performance.now();
  send("follow", { on: target.checked });
};
// Return the keys to steering after a control was used with the mouse.
addEventListener("change", ({ target }) => target.matches("select") && target.blur());
addEventListener("pointerup", ({ target }) => target.matches("input[type=range]") && target.blur());
at("scenario").onchange = () => {
  set_severity_slider();
  choose_scenario();
};
at("severity").oninput = show_severity_value;
at("severity").onchange = choose_scenario;
at("go").onclick = () => send("scenario", { name: at("scenario-name").value.trim() });
at("scenario-name").onkeydown = ({ key }) => key === "Enter" && at("go").click();
at("halt").onclick = halt;
at("let-go").onclick = () => send("let_go");
at("push").onclick = push;
at("pause").onclick = pause;
at("step").onclick = () => send("step");
at("reset").onclick = restart;
at("next").onclick = () => send("next");
at("speed").oninput = ({ target }) => {
  last_input = performance.now();
  send("speed", { factor: 2 ** Number(target.value) });
};

const frame = at("frame");
frame.onpointerdown = (event) => {
  frame.setPointerCapture(event.pointerId);
  frame.focus();
};
frame.onpointermove = (event) => {
  if (event.buttons) send("drag", { right: event.movementX, down: event.movementY });
};
frame.addEventListener("wheel", (event) => {
  event.preventDefault();
  send("zoom", { wheel: Math.max(-500, Math.min(500, event.deltaY)) });
}, { passive: false });

new Gamepads({ ranges: RANGES, steer, push, halt, pause, found: (name) => (at("pad").textContent = name) }).watch();
connect();
