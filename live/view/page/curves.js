// Curves of the latest seconds of the first robot.

const SECONDS = 6;
const EVERY = 2; // rows: a line has a point each 20 ms
const FEET = ["fl", "fr", "hl", "hr"];
const style = getComputedStyle(document.documentElement);
const colour = (name) => style.getPropertyValue(`--${name}`).trim();

export class Curves {
  constructor(at) {
    this.at = at;
    this.rows = [];
  }

  // Rows of live/view/telemetry.py: time, command, velocity, contacts, torque, reward, correction.
  add(rows) {
    for (const row of rows) {
      if (this.rows.length && row[0] <= this.rows.at(-1)[0]) this.rows = []; // a new episode
      this.rows.push(row);
    }
    const now = this.rows.at(-1)?.[0] ?? 0;
    const first = this.rows.findIndex((row) => row[0] > now - SECONDS);
    this.rows.splice(0, Math.max(0, first));
    if (document.hidden) return;
    for (const [index, id] of ["forward", "left", "turn"].entries()) {
      this.lines(id, [
        ["asked", (row) => row[1][index]],
        ["real", (row) => row[2][index]],
      ]);
    }
    this.lines("torque", [
      ["real", (row) => row[4]],
      ["second", (row) => row[6]],
    ], [0, 1]);
    this.lines("reward", [["real", (row) => row[5]]]);
    this.feet();
  }

  begin(id) {
    const canvas = this.at(id);
    const pen = canvas.getContext("2d");
    pen.clearRect(0, 0, canvas.width, canvas.height);
    const end = this.rows.at(-1)?.[0] ?? 0;
    const x = (time) => canvas.width * (1 - (end - time) / SECONDS);
    return { canvas, pen, x };
  }

  lines(id, curves, range = null) {
    const { canvas, pen, x } = this.begin(id);
    const values = curves.flatMap(([, value]) => this.rows.map(value)).filter((value) => value !== null);
    if (!values.length) return;
    let [low, high] = range ?? [Math.min(0, ...values), Math.max(0, ...values)];
    const margin = 0.08 * Math.max(high - low, 0.2);
    [low, high] = [low - margin, high + margin];
    const y = (value) => canvas.height * (1 - (value - low) / (high - low));
    pen.strokeStyle = pen.fillStyle = colour("dim");
    pen.lineWidth = 1;
    pen.beginPath();
    pen.moveTo(0, y(0));
    pen.lineTo(canvas.width, y(0));
    pen.stroke();
    pen.font = "20px system-ui";
    pen.fillText((high - margin).toFixed(2), 4, 20);
    pen.fillText((low + margin).toFixed(2), 4, canvas.height - 6);
    pen.lineWidth = 2;
    for (const [name, value] of curves) {
      pen.strokeStyle = colour(name);
      pen.beginPath();
      for (const row of this.rows) {
        if (Math.round(100 * row[0]) % EVERY === 0 && value(row) !== null) pen.lineTo(x(row[0]), y(value(row)));
      }
      pen.stroke();
    }
  }

  feet() {
    const { canvas, pen, x } = this.begin("contacts");
    const height = canvas.height / FEET.length;
    const width = Math.ceil(canvas.width / (SECONDS * 100)) + 1;
    pen.font = "20px system-ui";
    for (const [foot, name] of FEET.entries()) {
      pen.fillStyle = colour("real");
      for (const row of this.rows) if (row[3][foot]) pen.fillRect(x(row[0]), foot * height + 6, width, height - 12);
      pen.fillStyle = colour("panel");
      pen.fillRect(0, foot * height, 28, height);
      pen.fillStyle = colour("ink");
      pen.fillText(name, 4, foot * height + height / 2 + 7);
    }
  }
}
