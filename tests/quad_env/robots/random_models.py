"""Quadrupeds as MJCF text with random values of every attribute that affects motion, and a record of the values."""

from dataclasses import dataclass, field

import numpy as np

LEGS = {"FL": (1, 1), "FR": (1, -1), "RL": (-1, 1), "RR": (-1, -1)}
LINKS = "hip", "thigh", "calf"
RANGES = (-0.8, 0.8), (-1.6, 1.6), (-2.5, -0.3)
"""rad. Ranges of hip, thigh and calf in the robot convention."""
ARM = """<body name="arm" pos="0.05 0 0.05" gravcomp="{lift}">
<joint name="arm_0" axis="0 0 1" stiffness="3" damping="1"/>
<geom type="capsule" fromto="0 0 0 0 0 .2" size=".02" mass="0.7"/><body name="arm_1" pos="0 0 .2">
<joint name="arm_1" axis="0 1 0" armature=".1"/><geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".4"/>
</body></body>"""


def number(value: float) -> str:
    """Return the text of a number to its last bit."""
    return repr(float(value))


@dataclass
class Joint:
    """A leg joint: its sign and offset in the robot convention."""

    name: str
    sign: int
    zero: float
    """Angle at `qpos0` in the robot convention, rad."""
    ref: float


@dataclass
class Drawn:
    """A model, and its features that the robot must not have."""

    rng: np.random.Generator
    joints: list[Joint] = field(default_factory=list)
    headings: set[str] = field(default_factory=set)
    """Headings of the lines about omitted or replaced features."""
    motors: list[str] = field(default_factory=list)
    tendons: list[str] = field(default_factory=list)
    equalities: list[str] = field(default_factory=list)
    has_arm: bool = False
    unit: float = 1.0
    """Angle unit of the text, per radian."""
    xml: str = ""

    def often(self, share: float = 0.5) -> bool:
        """Return True with a probability."""
        return bool(self.rng.random() < share)

    def some(self, low: float, high: float, count: int = 1) -> str:
        """Return the text of uniform random values."""
        return " ".join(map(number, self.rng.uniform(low, high, count)))


def draw(seed: int) -> Drawn:
    """Return the model of a seed."""
    drawn = Drawn(np.random.default_rng(seed))
    degrees = drawn.often()
    drawn.unit = float(np.rad2deg(1.0)) if degrees else 1.0
    zeros = (0.2, 0.6, -1.1) if drawn.often() else (0.0, 0.0, 0.0)
    attributes, has_free_default = _class_attributes(drawn)
    free = '<joint name="root" type="free"/>' if drawn.often() else "<freejoint/>"
    if free.startswith("<joint") and has_free_default:
        drawn.headings.add("free joint")
    legs = "".join(_leg(drawn, leg, zeros) for leg in LEGS)
    drawn.has_arm = drawn.often(0.3)
    arm = ARM.format(lift=_gravcomp(drawn)) if drawn.has_arm else ""
    drawn.xml = (
        f'<mujoco><compiler angle="{"degree" if degrees else "radian"}" autolimits="true"/>{_option(drawn)}'
        f"<default><joint {attributes}/><geom {_contact(drawn)}/></default><worldbody>"
        f'<body name="trunk" pos="0 0 0.4" gravcomp="{_gravcomp(drawn)}">{free}{_inertial(drawn, 6.0, 0.1)}'
        f'<geom type="box" size="0.22 0.1 0.05"/>{legs}{arm}</body></worldbody>'
        f"{_section('actuator', drawn.motors)}{_section('tendon', drawn.tendons)}"
        f"{_section('equality', drawn.equalities)}</mujoco>"
    )
    if drawn.tendons or drawn.equalities:
        drawn.headings.add("left out")
    return drawn


def _section(name: str, parts: list[str]) -> str:
    return f"<{name}>{''.join(parts)}</{name}>" if parts else ""


def _option(drawn: Drawn) -> str:
    attributes = ""
    flags = ""
    if drawn.often(0.2):
        attributes += f' gravity="0 0 {drawn.some(-9.0, -1.0)}"'
    if drawn.often(0.2):
        attributes += f' density="{drawn.some(1.0, 900.0)}" viscosity="{drawn.some(0.1, 1.0)}" wind="1 0 0"'
    if drawn.often(0.2):
        flags = '<flag frictionloss="disable" filterparent="disable"/>'
    if attributes or flags:
        drawn.headings.add("settings")
    if drawn.often(0.3):
        attributes += ' timestep="0.004" integrator="Euler" solver="CG"'  # numerical settings; no message names them
    if drawn.often(0.7):
        attributes += ' actuatorgroupdisable="5"'
    return f"<option{attributes}>{flags}</option>"


def _class_attributes(drawn: Drawn) -> tuple[str, bool]:
    """Return the attributes of the default class of joints, and whether a free joint has them as well."""
    text = f'armature="{drawn.some(0.001, 0.02)}"' if drawn.often() else ""
    text += f' damping="{drawn.some(0.1, 2.0)}"' if drawn.often(0.3) else ""
    text += f' frictionloss="{drawn.some(0.1, 0.5)}"' if drawn.often(0.3) else ""
    text += f' stiffness="{drawn.some(1.0, 20.0)}"' if drawn.often(0.3) else ""
    return text, bool(text.strip())


def _contact(drawn: Drawn) -> str:
    text = f'friction="{drawn.some(0.4, 1.2)}"'
    own = ""
    for attribute, value in {
        "margin": drawn.some(0.001, 0.03),
        "gap": drawn.some(0.001, 0.01),
        "solref": f"{drawn.some(0.005, 0.05)} 1",
        "solimp": "0.8 0.99 0.002 0.5 2",
        "solmix": "2",
        "condim": "6",
        "priority": "1",
        "adhesion": "5",
        "surfacevel": "1 0 0 0 0 0",
    }.items():
        own += f' {attribute}="{value}"' if drawn.often(0.25) else ""
    if own:
        drawn.headings.add("contact")
    return text + own


def _gravcomp(drawn: Drawn) -> str:
    if drawn.often(0.9):
        return "0"
    drawn.headings.add("gravcomp")
    return drawn.some(0.3, 1.2)


def _inertial(drawn: Drawn, mass: float, size: float) -> str:
    """Return a body in any orientation; the inertia of three point masses satisfies A + B > C."""
    squares = drawn.rng.uniform(0.5, 1.5, 3) * size**2 / 3.0
    moments = mass * (squares.sum() - squares)
    place = f'pos="{drawn.some(-0.03, 0.03, 3)}" mass="{number(mass * drawn.rng.uniform(0.8, 1.2))}"'
    if drawn.often():
        angles = drawn.rng.uniform(-90.0, 90.0, 3) * drawn.unit / np.rad2deg(1.0)
        turned = " ".join(map(number, angles))
        return f'<inertial {place} euler="{turned}" diaginertia="{" ".join(map(number, moments))}"/>'
    rotation = np.linalg.qr(drawn.rng.normal(size=(3, 3)))[0]
    full = rotation @ np.diag(moments) @ rotation.T
    entries = (full[0, 0], full[1, 1], full[2, 2], full[0, 1], full[0, 2], full[1, 2])
    return f'<inertial {place} fullinertia="{" ".join(map(number, entries))}"/>'


def _masses(drawn: Drawn, mass: float, size: float) -> str:
    """Return the inertia of a link: explicit, or that of a visual shape."""
    if drawn.often(0.7):
        return _inertial(drawn, mass, size)
    turned = " ".join(map(number, drawn.rng.normal(size=4)))
    return (
        f'<geom type="ellipsoid" size="{drawn.some(0.01, 0.03, 3)}" pos="{drawn.some(-0.02, 0.02, 3)}" '
        f'quat="{turned}" mass="{drawn.some(0.2, 0.5)}" contype="0" conaffinity="0"/>'
    )


def _cable(drawn: Drawn, leg: str) -> None:
    """Add a motor on a tendon of thigh and calf to their own motors; some motors are disabled."""
    if drawn.often(0.9):
        return
    pulled = "".join(f'<joint joint="{leg}_{link}" coef="{drawn.some(-2.0, 2.0)}"/>' for link in LINKS[1:])
    drawn.tendons.append(f'<fixed name="{leg}_cable" frictionloss="0.1">{pulled}</fixed>')
    group = "5" if drawn.often(0.3) else "0"
    drawn.motors.append(f'<motor tendon="{leg}_cable" ctrlrange="-4 5" group="{group}"/>')
    drawn.motors.append(f'<motor joint="{leg}_hip" forcerange="-2 3" ctrlrange="-9 9" group="5"/>')


def _leg(drawn: Drawn, leg: str, zeros: tuple[float, float, float]) -> str:
    ahead, left = LEGS[leg]
    hip, upper, lower = zeros
    places = (0.2 * ahead, 0.1 * left, 0.0), (0.0, 0.08 * left, 0.0), (-0.2 * np.sin(upper), 0.0, -0.2 * np.cos(upper))
    text = ""
    for place, link in enumerate(LINKS):
        sign = 1 if drawn.often() else -1
        ref = float(drawn.rng.uniform(-1.0, 1.0)) if drawn.often(0.3) else 0.0
        joint = Joint(f"{leg}_{link}", sign, zeros[place], ref)
        drawn.joints.append(joint)
        turned = f'quat="{number(np.cos(hip / 2))} {number(np.sin(hip / 2))} 0 0"' if link == "hip" else ""
        text += (
            f'<body pos="{" ".join(map(number, places[place]))}" {turned} name="{joint.name}_link" '
            f'gravcomp="{_gravcomp(drawn)}">{_masses(drawn, 0.4, 0.08)}{_joint(drawn, joint, place)}'
        )
    _cable(drawn, leg)
    shin = upper + lower
    foot = f'<geom size="0.025" pos="{number(-0.22 * np.sin(shin))} 0 {number(-0.22 * np.cos(shin))}"/>'
    return text + foot + 3 * "</body>"


def _joint(drawn: Drawn, joint: Joint, place: int) -> str:
    ends = sorted(drawn.unit * (joint.ref + joint.sign * (end - joint.zero)) for end in RANGES[place])
    axis = f"{joint.sign} 0 0" if place == 0 else f"0 {joint.sign} 0"
    along = axis.replace("1", "0.01") if drawn.often(0.2) else "0 0 0"
    text = f'<joint name="{joint.name}" axis="{axis}" pos="{along}" range="{number(ends[0])} {number(ends[1])}"'
    text += f' ref="{number(drawn.unit * joint.ref)}"'
    if drawn.often(0.4):
        text += f' stiffness="{drawn.some(0.5, 5.0)} {drawn.some(-2.0, 2.0, 2)}"'
        text += f' springref="{number(drawn.unit * drawn.rng.uniform(-1.0, 1.0))}"'
    elif drawn.often(0.2):
        text += f' springdamper="{drawn.some(0.1, 0.5)} {drawn.some(0.3, 1.0)}"'
    if drawn.often(0.4):
        text += f' damping="{drawn.some(0.1, 1.0)} {drawn.some(0.0, 0.3, 2)}"'
    if drawn.often(0.3):
        text += f' frictionloss="{drawn.some(0.05, 0.5)}" armature="{drawn.some(0.001, 0.05)}"'
        text += ' solreffriction="0.03 1" solimplimit="0.8 0.9 0.01 0.5 2" solreflimit="0.04 1" margin="0.01"'
    if drawn.often(0.05):
        text += f' springyield="{number(drawn.unit * 0.3)}" actuatorgravcomp="true"'
        drawn.headings.add("springyield")
    if drawn.often(0.2):
        text += f' actuatorfrcrange="{drawn.some(-30.0, -5.0)} {drawn.some(5.0, 30.0)}"'
    _motors(drawn, joint)
    if drawn.often(0.03):
        drawn.equalities.append(f'<joint joint1="{joint.name}" polycoef="0.1 1 0 0 0"/>')
    return text + "/>"


def _motors(drawn: Drawn, joint: Joint) -> None:
    """Add one of the usual actuators of a joint."""
    at = f'joint="{joint.name}"' if drawn.often(0.9) else f'jointinparent="{joint.name}"'
    gear = f'gear="{number(drawn.rng.choice((-1, 1)) * drawn.rng.uniform(0.5, 3.0))}"' if drawn.often(0.3) else ""
    rotor = f'armature="{drawn.some(0.001, 0.01)}" damping="{drawn.some(0.01, 0.1, 3)}"' if drawn.often(0.2) else ""
    limit = f'ctrlrange="{drawn.some(-30.0, -10.0)} {drawn.some(10.0, 30.0)}"'
    force = f'forcerange="{drawn.some(-30.0, -10.0)} {drawn.some(10.0, 30.0)}"'
    kind = drawn.rng.integers(9)
    if kind < 3:
        drawn.motors.append(f"<motor {at} {gear} {rotor} {limit}/>")
    elif kind == 3:
        drawn.motors.append(f"<motor {at} {gear} {limit} {force}/>")
    elif kind == 4:
        drawn.motors.append(f'<position {at} {gear} {rotor} kp="60" {force}/>')
        drawn.motors.append(f'<velocity {at} kv="1" {force}/>')
    elif kind == 5:
        drawn.motors.append(f'<general {at} {gear} gainprm="2" biastype="affine" biasprm="1.5 0 0" {limit}/>')
    elif kind == 6:
        drawn.motors.append(f'<motor {at} {gear} ctrlrange="0 25"/>')
        drawn.motors.append(f'<motor {at} {gear} ctrlrange="-20 0" {rotor}/>')
    elif kind == 7:
        name = f"{joint.name}_tendon"
        clamp = 'actuatorfrcrange="-7 8"' if drawn.often() else ""
        passive = 'stiffness="3" damping="0.5" armature="0.01"' if drawn.often() else ""
        tendon = f'<fixed name="{name}" {clamp} {passive}><joint joint="{joint.name}" coef="{drawn.some(0.5, 3.0)}"/>'
        drawn.tendons.append(f"{tendon}</fixed>")
        drawn.motors.append(f'<motor tendon="{name}" {gear} {limit}/>')
    elif drawn.often(0.1):
        drawn.motors.append(f'<position {at} kp="60"/>')  # no limit
    else:
        drawn.motors.append(f'<pid {at} kp="50" kv="1" input="pos vel ff" {force}/>')
