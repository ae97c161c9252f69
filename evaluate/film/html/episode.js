// Film and curves of one episode for one or more policies, with a common time cursor.
"use strict";

const data = JSON.parse(document.getElementById("data").textContent);
const { episodes } = data;
const dt = episodes[0].dt;
const end = Math.max(...episodes.map((episode) => episode.end));
const at = (id) => document.getElementById(id);
const LEFT = 44, RIGHT = 8; // Left and right margin of the curves, pixels.
let now = 0, playing = null;

const svg = (name = "svg") => document.createElementNS("http://www.w3.org/2000/svg", name);

function make(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  Object.assign(element, attributes);
  element.append(...children);
  return element;
}

function draw(parent, name, attributes, text = "") {
  const element = svg(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.textContent = text;
  parent.append(element);
  return element;
}

const colour = (line) => `var(--${line.look})`;

// Return round numbers between `low` and `high`, about `count` of them, for the marks of an axis, and their decimals.
function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((each) => each * power >= rough);
  const found = [];
  for (let value = Math.ceil(low / step) * step; value <= high + step / 1e6; value += step) found.push(value);
  return { found, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
}

const scaled = (columns, factor) => columns?.map((values) => values.map((value) => value && factor * value)); // null stays null

// Return the charts of an episode: title and lines. Some have a minimum range of the scale, a limit, or bars as well.
function chartsOf({ curves, legs, fallen }) {
  const feet = (columns) => legs.map((name, leg) => ({ name, look: `foot-${leg}`, values: columns[leg] }));
  const lines = (actual, given, command) =>
    Object.entries({ actual, command, given })
      .filter(([, values]) => values)
      .map(([look, values]) => ({ name: look === "given" ? "given to the policy" : look, look, values }));
  const motion = (axis) => lines(curves.heading_velocity[axis], curves.given?.[axis + 1], curves.command[axis]);
  const degrees = 180 / Math.PI, [tilt] = scaled(curves.tilt, degrees), given = scaled(curves.given, degrees)?.[0];
  return [
    { title: "Feet on the ground", lines: feet(curves.foot_contact), bars: true },
    { title: "Tilt, °", lines: lines(tilt, given), limit: degrees * fallen.tilt },
    { title: "Trunk above ground, m", lines: lines(curves.height[0]), limit: fallen.height },
    { title: "Velocity forward, m/s", lines: motion(0) },
    { title: "Velocity left, m/s", lines: motion(1) },
    { title: "Yaw rate, rad/s", lines: motion(2) },
    { title: "Feet above ground, m", lines: feet(curves.foot_height), least: 0.05 },
    { title: "Largest torque of each leg, % of limit", lines: feet(scaled(curves.torque_share, 100)), limit: 100 },
  ];
}
for (const episode of episodes) episode.charts = chartsOf(episode);

class Chart {
  constructor(episode, number) {
    this.episode = episode;
    this.chart = episode.charts[number];
    this.same = episodes.map((each) => each.charts[number]); // All policies have the same range of the scale.
    this.values = this.chart.lines.map(() => make("span"));
    const named = this.chart.bars ? [] : this.chart.lines; // The names of bars are on the left of the bars.
    const legend = named.map((line, place) => {
      const swatch = make("i", { className: line.look, style: `color: ${colour(line)}` });
      return make("span", {}, swatch, `${line.name} `, this.values[place]);
    });
    const whose = episodes.length > 1 ? `${episode.label}: ` : "";
    const title = make("b", { textContent: whose + this.chart.title });
    this.svg = svg();
    this.svg.setAttribute("role", "img");
    this.svg.setAttribute("aria-label", `${whose}${this.chart.title} over time`);
    this.element = make("div", { className: "chart" }, make("p", {}, title, ...legend), this.svg);
    this.element.addEventListener("pointerdown", (event) => this.drag(event));
    this.element.addEventListener("pointermove", (event) => event.buttons && this.drag(event));
  }

  drag(event) {
    const box = this.svg.getBoundingClientRect();
    pause();
    go(((event.clientX - box.left - LEFT) / (box.width - LEFT - RIGHT)) * end);
  }

  x(time) {
    return LEFT + (time / end) * (this.width - LEFT - RIGHT);
  }

  resize() {
    this.width = Math.max(this.svg.clientWidth, 2 * (LEFT + RIGHT));
    const height = this.chart.bars ? 16 * this.chart.lines.length : 62;
    this.height = height;
    this.svg.replaceChildren();
    this.svg.setAttribute("height", height + 18);
    const across = ticks(0, end, this.width / 70);
    for (const time of across.found) {
      draw(this.svg, "line", { class: "grid", x1: this.x(time), x2: this.x(time), y1: 0, y2: height });
      const anchor = time > 0.97 * end ? "end" : "middle";
      draw(this.svg, "text", { x: this.x(time), y: height + 13, "text-anchor": anchor }, time.toFixed(across.digits));
    }
    draw(this.svg, "text", { x: 2, y: height + 13 }, "s");
    if (this.chart.bars) this.bars();
    else this.lines();
    for (const event of this.episode.events) {
      const [from, to] = [this.x(event.time), this.x(event.until ?? event.time)];
      const paint = `var(--${event.kind})`;
      if (to > from) draw(this.svg, "rect", { x: from, y: 0, width: to - from, height, fill: paint, opacity: 0.25 });
      const style = event.kind === "command" ? "5 3" : "none";
      const line = { class: "event", x1: from, x2: from, y1: 0, y2: height, stroke: paint, "stroke-dasharray": style };
      draw(this.svg, "line", line);
    }
    this.cursor = draw(this.svg, "line", { class: "cursor", y1: 0, y2: height });
  }

  lines() {
    const values = this.same.flatMap((chart) => chart.lines.flatMap((line) => line.values));
    const all = values.filter((each) => each !== null);
    const limit = this.chart.limit;
    let [low, high] = [Math.min(0, ...all, limit ?? 0), Math.max(...all, limit ?? 0)];
    high = Math.max(high, low + (this.chart.least ?? 0.5));
    const y = (value) => 3 + (1 - (value - low) / (high - low)) * (this.height - 6);
    const up = ticks(low, high, 4.5);
    this.digits = high - low < 20 ? Math.max(2, up.digits + 1) : 0;
    for (const value of up.found) {
      draw(this.svg, "line", { class: "grid", x1: LEFT, x2: this.width - RIGHT, y1: y(value), y2: y(value) });
      const text = { x: LEFT - 5, y: Math.min(Math.max(y(value) + 4, 10), this.height), "text-anchor": "end" };
      draw(this.svg, "text", text, value.toFixed(up.digits).replace("-", "−"));
    }
    if (limit) draw(this.svg, "line", { class: "limit", x1: LEFT, x2: this.width - RIGHT, y1: y(limit), y2: y(limit) });
    for (const line of [...this.chart.lines].reverse()) {
      let path = "", gap = true;
      line.values.forEach((value, row) => {
        if (value !== null) path += `${gap ? "M" : "L"}${this.x((row + 1) * dt).toFixed(1)} ${y(value).toFixed(1)}`;
        gap = value === null;
      });
      draw(this.svg, "path", { class: `line ${line.look}`, d: path, stroke: colour(line) });
    }
  }

  bars() {
    this.chart.lines.forEach((line, place) => {
      const top = 16 * place;
      draw(this.svg, "text", { x: LEFT - 5, y: top + 12, "text-anchor": "end" }, line.name);
      let since = null;
      [...line.values, 0].forEach((on, row) => {
        if (on && since === null) since = row;
        if (on || since === null) return;
        const [from, to] = [this.x(since * dt), this.x(row * dt)];
        draw(this.svg, "rect", { x: from, y: top + 3, width: to - from, height: 10, fill: colour(line) });
        since = null;
      });
    });
  }

  show(row) {
    this.cursor.setAttribute("x1", this.x(now));
    this.cursor.setAttribute("x2", this.x(now));
    this.chart.lines.forEach((line, place) => {
      const words = line.values[row]?.toFixed(this.digits) ?? "";
      this.values[place].textContent = words.replace("-", Number(words) ? "−" : "");
    });
  }
}

// Timeline with the names of the events of an episode, in enough rows that the names do not overlap.
class Events {
  constructor(episode) {
    this.episode = episode;
    this.svg = svg();
    this.svg.setAttribute("role", "img");
    const words = episode.events.map((event) => `${event.time.toFixed(2)} s ${event.words}`);
    this.svg.setAttribute("aria-label", `Events: ${words.join("; ") || "none"}`);
    this.element = make("div", { className: "chart" }, this.svg);
  }

  resize() {
    const width = this.svg.clientWidth, ends = [];
    this.svg.replaceChildren();
    for (const event of this.episode.events) {
      const x = LEFT + (event.time / end) * (width - LEFT - RIGHT);
      const text = draw(this.svg, "text", { x, style: `fill: var(--${event.kind}); font-weight: 600` }, event.words);
      const length = text.getComputedTextLength(), left = Math.max(0, Math.min(x - 2, width - length - 2));
      let row = ends.findIndex((used) => used < left);
      if (row < 0) row = ends.length;
      ends[row] = left + length + 8;
      text.setAttribute("x", left);
      text.setAttribute("y", 12 + 14 * row);
    }
    this.svg.setAttribute("height", 14 * ends.length + 4);
  }

  show() {}
}

const charts = episodes.map((episode) => new Events(episode));
for (const number of episodes[0].charts.keys()) charts.push(...episodes.map((episode) => new Chart(episode, number)));

const films = episodes.map((episode) => {
  const image = make("img", { draggable: false });
  const caption = make("figcaption");
  at("films").append(make("figure", {}, image, caption));
  return { episode, image, caption };
});

const moments = [];
for (const episode of episodes) {
  const lines = episode.story.map(({ time, words }) => {
    const told = time === null ? [words] : [make("b", { textContent: `${time.toFixed(2)} s` }), " ", words];
    const button = make("button", { type: "button" }, ...told);
    button.addEventListener("click", () => {
      pause();
      go(time ?? now);
    });
    moments.push({ time: time ?? Infinity, button });
    return make("li", {}, button);
  });
  const verdict = make("h2", { textContent: `${episode.label}: ${episode.verdict}` });
  verdict.classList.toggle("failed", episode.failed);
  at("stories").append(make("section", {}, verdict, make("ol", { className: "story" }, ...lines)));
}

function go(time) {
  now = Math.round(Math.min(Math.max(time, 0), end) / dt) * dt;
  at("time").value = now;
  at("clock").textContent = `${now.toFixed(2)} s`;
  for (const { episode, image, caption } of films) {
    const frame = Math.min(Math.round(now / data.period), episode.frames.length - 1);
    if (image.dataset.frame !== String(frame)) {
      image.src = episode.frames[frame];
      image.dataset.frame = frame;
      image.alt = `${episode.label} at ${(frame * data.period).toFixed(2)} s`;
    }
    const fell = episode.events.find((event) => event.kind === "fall" && event.time <= now + dt / 2);
    caption.textContent = episode.label + (fell ? ` ${fell.words}` : "");
  }
  for (const { time, button } of moments) button.classList.toggle("past", time <= now + dt / 2);
  const row = Math.round(now / dt) - 1;
  for (const chart of charts) chart.show(row);
}

function pause() {
  if (playing !== null) cancelAnimationFrame(playing);
  playing = null;
  at("play").textContent = "Play";
}

function play() {
  if (now >= end - dt / 2) go(0);
  let last = null, exact = now;
  const tick = (clock) => {
    if (last !== null) exact += ((clock - last) / 1000) * Number(at("speed").value);
    last = clock;
    go(exact);
    if (exact >= end) pause();
    else playing = requestAnimationFrame(tick);
  };
  at("play").textContent = "Pause";
  playing = requestAnimationFrame(tick);
}

const toggle = () => (playing === null ? play() : pause());
at("play").addEventListener("click", toggle);
at("time").addEventListener("input", (event) => {
  pause();
  go(Number(event.target.value));
});
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || event.target.id === "speed") return;
  const step = event.shiftKey ? dt : data.period;
  const moves = { ArrowLeft: now - step, ArrowRight: now + step, Home: 0, End: end };
  if (event.key in moves) {
    pause();
    go(moves[event.key]);
  } else if (event.key === " " && event.target.tagName !== "BUTTON") toggle();
  else return;
  event.preventDefault();
});

function resize() {
  for (const chart of charts) chart.resize();
  go(now);
}

document.documentElement.style.setProperty("--count", episodes.length);
at("stories").className = at("charts").className = "row";
document.body.classList.toggle("several", episodes.length > 1);
at("charts").append(...charts.map((chart) => chart.element));
at("time").max = end;
at("time").step = dt;
now = data.start;
resize();
new ResizeObserver(resize).observe(at("charts").parentElement);
