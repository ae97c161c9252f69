// Curves of the latest seconds of every robot, each in its colour.

const SECONDS = 6;
const ROW_STRIDE = 2; // rows: a line has a point each 20 ms
const FEET = ["fl", "fr", "hl", "hr"];
const style = getComputedStyle(document.documentElement);
const colour = (name) => style.getPropertyValue(`--${name}`).trim();

export class Curves {
  constructor(at) {
    this.at = at;
    this.robots = []; // rows of each
  }

  // Rows of live/view/telemetry.py: time, command, velocity, contacts, torque, reward.
  add(robots) {
    this.robots = robots.map(({ rows }, number) => {
      const kept = rows.length ? (this.robots[number] ?? []).filter(([time]) => time < rows[0][0]) : this.robots[number] ?? [];
      const all = [...kept, ...rows];
      return all.filter(([time]) => time > all.at(-1)[0] - SECONDS);
    });
    this.end = this.robots[0]?.at(-1)?.[0] ?? 0;
    if (document.hidden) return;
    for (const [index, id] of ["forward", "left", "turn"].entries()) this.lines(id, (row) => row[2][index], (row) => row[1][index]);
    this.lines("torque", (row) => row[4], null, [0, 1]);
    this.lines("reward", (row) => row[5]);
    this.feet();
  }

  begin(id) {
    const canvas = this.at(id);
    const scale = devicePixelRatio;
    [canvas.width, canvas.height] = [scale * canvas.clientWidth, scale * canvas.clientHeight];
    const pen = canvas.getContext("2d");
    pen.scale(scale, scale);
    pen.font = "11px system-ui";
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    return { pen, width, height, x: (time) => width * (1 - (this.end - time) / SECONDS) };
  }

  // A line of each robot, and the command that all of them have.
  lines(id, value, asked = null, range = null) {
    const { pen, width, height, x } = this.begin(id);
    const curves = [...(asked ? [["asked", this.robots[0] ?? [], asked]] : []), ...this.robots.map((rows, number) => [`robot-${number}`, rows, value])];
    const values = curves.flatMap(([, rows, of]) => rows.map(of));
    let [low, high] = range ?? [Math.min(0, ...values), Math.max(0, ...values)];
    const margin = 0.08 * Math.max(high - low, 0.2);
    [low, high] = [low - margin, high + margin];
    const y = (value) => height * (1 - (value - low) / (high - low));
    pen.strokeStyle = pen.fillStyle = colour("dim");
    pen.beginPath();
    pen.moveTo(0, y(0));
    pen.lineTo(width, y(0));
    pen.stroke();
    for (const [name, rows, of] of curves) {
      pen.strokeStyle = colour(name);
      pen.beginPath();
      for (const row of rows) if (Math.round(100 * row[0]) % ROW_STRIDE === 0) pen.lineTo(x(row[0]), y(of(row)));
      pen.stroke();
    }
    pen.strokeStyle = colour("panel");
    pen.lineWidth = 3;
    for (const [number, bottom] of [[high - margin, 11], [low + margin, height - 3]]) {
      pen.strokeText(number.toFixed(2), 4, bottom);
      pen.fillText(number.toFixed(2), 4, bottom);
    }
  }

  // A bar of each foot, in it a stripe of each robot.
  feet() {
    const { pen, width, height, x } = this.begin("contacts");
    const [bar, row_width] = [height / FEET.length, Math.ceil(width / (SECONDS * 100))];
    const stripe = (bar - 4) / this.robots.length;
    for (const [foot, name] of FEET.entries()) {
      this.robots.forEach((rows, number) => {
        pen.fillStyle = colour(`robot-${number}`);
        for (const row of rows) if (row[3][foot]) pen.fillRect(x(row[0]), foot * bar + 2 + number * stripe, row_width, stripe);
      });
      pen.fillStyle = colour("panel");
      pen.fillRect(0, foot * bar, 18, bar);
      pen.fillStyle = colour("ink");
      pen.fillText(name, 4, foot * bar + bar / 2 + 4);
    }
  }
}
