// The page of the live view: shows what it is sent, sends what is to be done. Messages: live/view/requests.py.
import { Curves } from "./curves.js";
import { Gamepads } from "./gamepads.js";

const at = (id) => document.getElementById(id);
const RANGES = { forward: [-1, 1.5], left: [-0.8, 0.8], turn: [-1.2, 1.2] };
const STEPS = { forward: 0.1, left: 0.1, turn: 0.2 };
const SETTLING = 400; // ms after something was set here in which the reported state does not set it back
const KEPT_EVENTS = 12;

const command = { forward: 0, left: 0, turn: 0 };
const curves = new Curves(at);
let socket = null;
let axes = [];
let latest = null; // the latest state
let decoding = 0; // frames that came and are not shown yet
let set = 0; // when something was set here, ms

function send(what, values = {}) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ do: what, ...values }));
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
  socket.onmessage = ({ data }) => (typeof data === "string" ? take(JSON.parse(data)) : show(data));
}

const taken = () => socket?.readyState === WebSocket.OPEN && socket.send("drawn");

// Shows a frame; the next one may come while this one is being decoded, and no further one until it is shown.
async function show(file) {
  const first = decoding === 0;
  decoding += 1;
  if (first) taken();
  const canvas = at("frame");
  const picture = await createImageBitmap(new Blob([file], { type: "image/jpeg" }));
  if (canvas.width !== picture.width || canvas.height !== picture.height) {
    canvas.width = picture.width;
    canvas.height = picture.height;
  }
  canvas.getContext("2d").drawImage(picture, 0, 0);
  picture.close();
  canvas.dataset.frames = Number(canvas.dataset.frames ?? 0) + 1;
  decoding -= 1;
  if (!first) taken();
}

function take(message) {
  if (message.kind === "offer") offered(message);
  if (message.kind === "state") stated(message);
  if (message.kind === "error") happened(message.text, "bad");
}

function offered({ robot, policies, axes: offeredAxes }) {
  document.title = `SimpleQuad: ${robot}`;
  axes = offeredAxes;
  for (const select of [at("policy-0"), at("policy-1")]) select.replaceChildren(...policies.map((name) => new Option(name)));
  at("scenario").replaceChildren(new Option("flat"), ...axes.map(({ name }) => new Option(name)).filter((o) => o.value !== "flat"));
  severity();
  if (latest) show_scenario(latest.scenario);
}

const chosen_axis = () => axes.find(({ name }) => name === at("scenario").value);

// The slider of the chosen axis's severity, from its mildest to its hardest level.
function severity(value) {
  const axis = chosen_axis();
  at("severity-label").hidden = !axis || axis.levels.length < 2;
  if (!axis) return;
  const slider = at("severity");
  slider.min = Math.min(...axis.levels);
  slider.max = Math.max(...axis.levels);
  slider.value = value ?? axis.nominal;
  told_severity();
}

function told_severity() {
  at("severity-value").textContent = `${Number(at("severity").value).toPrecision(3)} ${chosen_axis().unit}`;
}

// Has the choice be that of a scenario's name: rough, rough:3, rough=0.12; another one leaves it as it is.
function show_scenario(called) {
  const [, name, sign, value] = called.match(/^(\w+)(?:([:=])([\d.e-]+))?$/) ?? [];
  const axis = axes.find((each) => each.name === name);
  if (!axis && name !== "flat") return;
  at("scenario").value = name;
  severity(sign === ":" ? axis.levels[value - 1] : sign === "=" ? Number(value) : undefined);
}

function choose_scenario() {
  const name = at("scenario").value;
  const axis = chosen_axis();
  send("scenario", { name: axis && axis.levels.length > 1 ? `${name}=${Number(Number(at("severity").value).toPrecision(3))}` : name });
}

function stated(state) {
  const first = !latest;
  if (latest?.scenario !== state.scenario) show_scenario(state.scenario);
  latest = state;
  const here = performance.now() - set > SETTLING;
  if (here || first) {
    [command.forward, command.left, command.turn] = state.command;
    sliders();
    at("follow").checked = state.follow;
    at("compare").checked = state.robots.length > 1;
    at("speed").value = Math.round(Math.log2(state.speed));
    state.robots.forEach(({ policy }, number) => name_policy(at(`policy-${number}`), policy));
  }
  at("second").hidden = state.robots.length < 2;
  at("pause").textContent = state.paused ? "go on" : "pause";
  at("speed-value").textContent = `${state.speed} ×`;
  at("clock").textContent = `${state.time.toFixed(2)} s, ${state.scenario}, seed ${state.seed}${state.paused ? ", paused" : ""}`;
  at("rate").textContent = `${state.measured.toFixed(2)} × real time, ${state.frames} frames/s`;
  if (state.drawing) notice(state.drawing);
  table(state);
  curves.add(state.rows);
  for (const event of state.events) happened(event);
}

function name_policy(select, name) {
  if (!select || document.activeElement === select) return;
  if (![...select.options].some(({ value }) => value === name)) select.add(new Option(name));
  select.value = name;
}

const HEADS = ["robot", "state", "forward", "left", "turning", "x, m", "y, m", "heading", "height", "tilt", "torque", "correction"];

function table({ robots }) {
  const rows = robots.map((robot, number) => {
    const share = (value) => (value === null ? "–" : `${Math.round(100 * value)} %`);
    const cells = [
      robot.policy,
      robot.failure ? `${robot.state}; the policy has failed: ${robot.failure}` : robot.state,
      ...robot.velocity.map((value) => value.toFixed(2)),
      robot.position[0].toFixed(2),
      robot.position[1].toFixed(2),
      `${robot.heading.toFixed(0)}°`,
      robot.height.toFixed(2),
      `${robot.tilt.toFixed(0)}°`,
      share(robot.torque),
      share(robot.correction),
    ];
    const row = document.createElement("tr");
    row.id = `robot-${number}`;
    row.append(
      ...cells.map((text, column) => {
        const cell = document.createElement("td");
        cell.textContent = text;
        cell.dataset.name = HEADS[column];
        if (column === 1 && (robot.failure || robot.state !== "upright")) cell.className = "bad";
        return cell;
      }),
    );
    return row;
  });
  const head = document.createElement("tr");
  head.append(
    ...HEADS.map((text) => {
      const cell = document.createElement("th");
      cell.textContent = text;
      return cell;
    }),
  );
  const whole = document.createElement("table");
  whole.append(head, ...rows);
  at("robots").replaceChildren(whole, rewards(robots[0]));
}

function rewards({ rewards: terms }) {
  const line = document.createElement("p");
  line.className = "strip";
  line.textContent = "reward: " + Object.entries(terms).map(([name, value]) => `${name} ${value.toFixed(3)}`).join(", ");
  return line;
}

function happened(text, kind = "") {
  const item = document.createElement("li");
  item.textContent = text;
  item.className = kind;
  at("events").prepend(item);
  while (at("events").childElementCount > KEPT_EVENTS) at("events").lastElementChild.remove();
}

function notice(text) {
  at("notice").textContent = text;
}

function sliders() {
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
  set = performance.now();
  sliders();
  send("steer", command);
}

const halt = () => steer({ forward: 0, left: 0, turn: 0 });
const push = () => send("push", { direction: Number(at("direction").value), impulse: Number(at("impulse").value) });
const pause = () => send("pause", { on: !latest?.paused });
const again = () => send("reset", { seed: latest?.seed ?? 0 });
const follow = () => send("follow", { on: !latest?.follow });

const KEYS = {
  ArrowUp: () => steer({ forward: command.forward + STEPS.forward }),
  ArrowDown: () => steer({ forward: command.forward - STEPS.forward }),
  ArrowLeft: () => steer({ turn: command.turn + STEPS.turn }),
  ArrowRight: () => steer({ turn: command.turn - STEPS.turn }),
  a: () => steer({ left: command.left + STEPS.left }),
  d: () => steer({ left: command.left - STEPS.left }),
  " ": halt,
  x: push,
  p: pause,
  ".": () => send("step"),
  r: again,
  n: () => send("next"),
  f: follow,
};

addEventListener("keydown", (event) => {
  const writing = ["INPUT", "SELECT", "TEXTAREA"].includes(event.target.tagName) && event.target.type !== "checkbox";
  if (writing || event.ctrlKey || event.altKey || event.metaKey) return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (!(key in KEYS)) return;
  event.preventDefault();
  KEYS[key]();
});

for (const name of Object.keys(command)) at(`${name}-slider`).oninput = ({ target }) => steer({ [name]: Number(target.value) });
for (const [id, unit] of [["direction", "°"], ["impulse", " N·s"]]) {
  const tell = () => (at(`${id}-value`).textContent = at(id).value + unit);
  at(id).oninput = tell;
  tell();
}
for (const number of [0, 1]) at(`policy-${number}`).onchange = ({ target }) => send("policy", { robot: number, name: target.value });
for (const id of ["follow", "compare"]) {
  at(id).onchange = ({ target }) => {
    set = performance.now();
    send(id, { on: target.checked });
  };
}
at("scenario").onchange = () => {
  severity();
  choose_scenario();
};
at("severity").oninput = told_severity;
at("severity").onchange = choose_scenario;
at("go").onclick = () => send("scenario", { name: at("scenario-name").value.trim() });
at("scenario-name").onkeydown = ({ key }) => key === "Enter" && at("go").click();
at("halt").onclick = halt;
at("let-go").onclick = () => send("let_go");
at("push").onclick = push;
at("pause").onclick = pause;
at("step").onclick = () => send("step");
at("reset").onclick = again;
at("next").onclick = () => send("next");
at("speed").oninput = ({ target }) => {
  set = performance.now();
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
