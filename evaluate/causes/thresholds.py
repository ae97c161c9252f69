"""Every threshold of the rules of causes: value, unit and reason. Those with a unit of length, time or speed are
SimpleQuad's, and go with the robot's leg length, see `quad_env.robots.similarity`."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Threshold:
    """A figure that a rule decides by."""

    value: float
    unit: str
    reason: str


THRESHOLDS = {
    "tilt": Threshold(0.2, "rad", "of the trunk; no walk on level ground comes to it"),
    "height": Threshold(0.5, "", "trunk's height by that of the home pose; crouching gaits walk at 0.6"),
    "capture": Threshold(0.2, "m", "capture point from the middle of the feet, beyond what the command asks for"),
    "usual share": Threshold(0.98, "", "of its earlier steps in which an episode's gait counts as ordinary"),
    "usual margin": Threshold(0.2, "", "above that: gaits sway"),
    "start": Threshold(0.2, "s", "of an episode that is no ordinary gait: the policy begins"),
    "before the fall": Threshold(1.2, "s", "that are no ordinary gait: most falls take less"),
    "stride": Threshold(0.4, "s", "of ordinary gait that are needed to know it"),
    "look back": Threshold(0.35, "s", "before the onset in which its cause is looked for: a stride"),
    "look on": Threshold(0.05, "s", "after the onset, for what is seen a moment later than it acts"),
    "rise": Threshold(0.02, "m", "of the ground before a foot or shin: a foot's radius"),
    "reach of a riser": Threshold(0.05, "m", "before and behind a foot or shin in which the ground's rise is measured"),
    "speed lost": Threshold(0.5, "m/s", "by a swinging foot or shin within two steps of the control"),
    "slide": Threshold(0.4, "m/s", "of a standing foot: rolling over it gives less than 0.2 m/s"),
    "sliding": Threshold(0.55, "", "share of standing feet and time that slide; on grippy ground at most 0.35"),
    "push": Threshold(0.3, "m", "by which a push moves the capture point: half a leg"),
    "push before": Threshold(1.2, "s", "from a push to the onset of the fall"),
    "force": Threshold(0.3, "weight", "of a steady force: a lean of 17°"),
    "saturated": Threshold(0.95, "", "mean torque of 50 ms by the motor's limit"),
    "saturated joints": Threshold(0.1, "", "share of joints and time: more than one joint of twelve always"),
    "lag": Threshold(0.35, "rad", "mean of the largest error of the servos, where their bandwidth is limited"),
    "grip": Threshold(0.5, "", "friction above which feet that slide have been driven to it: it counts in proportion less"),
    "at limits": Threshold(0.6, "", "share of standing legs and time at a joint limit, or stretched; crouching gaits 0.4"),
    "stretched": Threshold(0.98, "", "length of a leg by its longest"),
    "tilt estimate": Threshold(0.2, "rad", "error of the gravity shown to the policy, root mean square"),
    "velocity estimate": Threshold(0.5, "m/s", "error of the planar velocity shown, root mean square"),
    "delay": Threshold(0.4, "", "of readings and actions together by √(height / g), the time constant of falling"),
    "held": Threshold(0.15, "rad", "between the target that a joint was sent and the one that it held"),
    "certain": Threshold(1.5, "", "strength of a cause that is stated as certain, if no other comes to 1"),
}
"""By name."""


def at(name: str) -> float:
    """The value of a threshold."""
    return THRESHOLDS[name].value
