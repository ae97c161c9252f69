"""Whether a robot goes the way it is asked to: ahead, to the left, round."""

from contextlib import closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import policies
from evaluate.measures.outcomes import RULES, SUCCESS_RULE
from policies.base import Policy
from quad_env.config import FALL_REASONS
from quad_env.doctor.check import Finding, ok, problem
from quad_env.doctor.subject import Subject
from quad_env.envs.vector_env import SimpleQuadVectorEnv
from quad_env.robots.robot import Robot
from quad_env.robots.similarity import ratio

WALKER = "trot_feedback"
"""It walks every robot that has a name here without a search."""
COMMANDS = {"ahead": (0.5, 0.0, 0.0), "to the left": (0.0, 0.4, 0.0), "round to the left": (0.0, 0.0, 0.8)}
"""Of SimpleQuad: m/s and rad/s; of other robots as much as is as fast for them."""
UNITS, ASIDE = ("m/s", "m/s", "rad/s"), ("ahead", "to the left", "of yaw rate")
SECONDS, SETTLING = 4.0, 2.0
"""Of a walk, and until it is looked at."""
OFF, SHARE = RULES[SUCCESS_RULE].linear, RULES[SUCCESS_RULE].share
"""How far off the command is still on it, m/s or rad/s, as of the rule of success, and a share of the command more."""


@dataclass(frozen=True)
class Walk:
    """What came of a command."""

    way: str
    asked: NDArray[np.float64]
    """Forward and lateral m/s, yaw rate rad/s, (3,)."""
    gone: NDArray[np.float64]
    """The same, mean after it has settled."""
    allowed: NDArray[np.float64]
    """Farthest that `gone` may be from `asked`, (3,)."""
    fell: str
    """Why, or nothing."""

    @property
    def good(self) -> bool:
        """Whether it went as asked."""
        return not self.fell and bool((np.abs(self.gone - self.asked) <= self.allowed).all())

    @property
    def words(self) -> str:
        """`ahead 0.49 of 0.50 m/s`, and where it goes besides if that is what is wrong."""
        if self.fell:
            return f"asked to go {self.way} it falls ({self.fell})"
        axis, worst = int(np.abs(self.asked).argmax()), int((np.abs(self.gone - self.asked) / self.allowed).argmax())
        told = f"{self.way} {_rounded(self.gone[axis])} of {self.asked[axis]:.2f} {UNITS[axis]}"
        if self.good or worst == axis:
            return told
        return f"{told}, with {_rounded(self.gone[worst])} {UNITS[worst]} {ASIDE[worst]}"


def _rounded(value: float) -> str:
    return f"{round(float(value), 2) + 0.0:.2f}"  # of −0, 0


def walk(policy: Policy, robot: Robot) -> list[Walk]:
    """A walk by each of COMMANDS, side by side."""
    faster = np.array([ratio(robot, "m/s"), ratio(robot, "m/s"), ratio(robot, "rad/s")])
    asked = faster * np.array(list(COMMANDS.values()))
    env = SimpleQuadVectorEnv(
        len(asked), robot=robot, max_episode_steps=None, autoreset_mode="DISABLED", height_scan=policy.height_scan
    )
    with closing(env):
        observation, _ = env.reset(seed=0, options={"command": asked})
        policy.reset(num_envs=len(asked), seed=0)
        fall, gone = np.zeros(len(asked), int), []
        for _ in range(round(SECONDS / env.dt)):
            observation, _, _, _, infos = env.step(policy.act(observation))
            fall = np.where(fall > 0, fall, infos["fall"])
            gone.append(infos["heading_velocity"])
        settled = np.mean(gone[round(SETTLING / env.dt) :], axis=0)
    planar = np.linalg.norm(asked[:, :2], axis=1, keepdims=True)
    allowed = OFF * faster + SHARE * np.hstack((planar, planar, np.abs(asked[:, 2:])))
    fell = [FALL_REASONS[code].replace("_", " ") if code else "" for code in fall]
    return [Walk(*each) for each in zip(COMMANDS, asked, settled, allowed, fell, strict=True)]


def walks(subject: Subject) -> Finding:
    """Whether the robot walks with a policy that walks others."""
    robot = subject.robot
    found = walk(policies.make(WALKER, robot=robot), robot)
    if all(each.good for each in found):
        return ok(f"{WALKER}: {'; '.join(each.words for each in found)}")
    bad = "; ".join(each.words for each in found if not each.good)
    cause = f"it stands, so masses, inertias or limits are unlike those that {WALKER} was made for"
    name = robot.source or robot.name
    return problem(
        f"{WALKER} {bad}",
        cause,
        f"mend masses and inertias in {robot.mjcf}, or search its trot: python -m train robot {name}",
    )
