// Steering by gamepad: left stick forward and to the sides, right stick turns.

const DEAD_ZONE = 0.12; // fraction of a stick's range that counts as at rest
const PERIOD = 50; // ms between two commands
const PUSH = 0, HALT = 1, PAUSE = 9; // buttons of the standard layout

export class Gamepads {
  constructor({ ranges, steer, push, halt, pause, found }) {
    Object.assign(this, { ranges, steer, push, halt, pause, found });
    this.moved = false;
    this.pressed = new Set();
  }

  watch() {
    setInterval(() => this.look(), PERIOD);
  }

  look() {
    const pad = [...navigator.getGamepads()].find((each) => each?.connected);
    this.found(pad ? `gamepad: ${pad.id}` : "");
    if (!pad) return;
    const stick = (axis, [low, high]) => {
      const way = -(pad.axes[axis] ?? 0);
      if (Math.abs(way) < DEAD_ZONE) return 0;
      const share = (Math.abs(way) - DEAD_ZONE) / (1 - DEAD_ZONE);
      return way > 0 ? share * high : share * low;
    };
    const { forward, left, turn } = this.ranges;
    const asked = { forward: stick(1, forward), left: stick(0, left), turn: stick(2, turn) };
    const moving = Object.values(asked).some((value) => value !== 0);
    if (moving || this.moved) this.steer(asked); // once more when the sticks come to rest
    this.moved = moving;
    for (const [button, act] of [[PUSH, this.push], [HALT, this.halt], [PAUSE, this.pause]]) {
      const down = pad.buttons[button]?.pressed ?? false;
      if (down && !this.pressed.has(button)) act();
      down ? this.pressed.add(button) : this.pressed.delete(button);
    }
  }
}
