"""Definitions of all measures (numbers per episode): title, unit, frame, formula and source."""

from dataclasses import dataclass
from typing import Literal

from evaluate.measures import effort, footfalls, gait_quality, pushes, tracking
from evaluate.measures.outcomes import MIN_PROGRESS, RULES, SUCCESS_RULE

Scope = Literal["whole episode", "while upright"]


@dataclass(frozen=True)
class Measure:
    """Definition of one measure of an episode, as shown in reports."""

    name: str
    """Name of the measure: a field of `evaluate.measures.metrics.Measures` and a column of episodes.parquet."""
    title: str
    """Title of the measure in tables."""
    unit: str
    """Unit of the measure; empty for a fraction or a pure number."""
    frame: str
    """Coordinate frame of the measure, for example `heading`; empty if the measure has no frame."""
    formula: str
    """Formula or definition of the measure in words, with the symbols that KEY explains."""
    source: str = ""
    """Publication, or version of a rule of this project, that defines the measure; empty if there is none."""
    scope: Scope = "while upright"
    """Control steps that enter the measure: the whole episode, or only the steps before a fall."""


KEY = (
    "e, v: commanded and actual velocity; q, a: angles and targets of the joints; tau: torques as the joints received "
    "them, implicitly integrated damping included; h: physics step; P: tau times the mean of the speeds before and "
    "after it; dt: control step; "
    "<x>: mean over the steps after the first second; [x]: share in which x holds. While upright: of the "
    "steps and pushes before a fall alone, which can flatter a robot that falls."
)
"""Explanation of the symbols in the formulas of measures, and of the scope `while upright`, for reports."""
WHOLE: Scope = "whole episode"
ENERGY = f"rule {effort.ENERGY_RULE}"
CAP = f"{tracking.VELOCITY_CAP:g} m/s"
YAW_CAP = f"{tracking.YAW_RATE_CAP:g} rad/s"
FOOTFALL = f"contact sensors; a swing lasts at least {footfalls.MIN_SWING_TIME:g} s"


MEASURES = (
    Measure("outcome", "outcome", "", "heading",
            f"succeeded: {RULES[SUCCESS_RULE].description}; policy_error: the policy raised, gave no answer in time or "
            f"none that is finite; stalled: upright and less than {100 * MIN_PROGRESS:g} % of the commanded distance "
            "in such an interval or in all (of the turn where none was commanded), or stopped by a safety layer; else "
            "off_command, fell or diverged", f"rule {SUCCESS_RULE}", WHOLE),
    Measure("fell", "falls", "", "", "the fall rule held, or the simulation diverged, before the time limit",
            "rule simple-quad/1", WHOLE),
    Measure("diverged", "diverged", "", "", "MuJoCo warned of a bad state, or a state is not finite",
            "MuJoCo warnings", WHOLE),
    Measure("fall_time", "time to fall", "s", "", "start to fall; none without a fall", scope=WHOLE),
    Measure("velocity_error", "velocity error", "m/s", "heading",
            f"<min(|e - v|, {CAP})>, planar; {CAP} for every step after a fall", scope=WHOLE),
    Measure("yaw_rate_error", "yaw-rate error", "rad/s", "world vertical",
            f"<min(|e - v|, {YAW_CAP})>; {YAW_CAP} for every step after a fall", scope=WHOLE),
    Measure("mean_velocity_error", "mean velocity error", "m/s", "heading",
            f"|e - mean v| of each command interval after its first second, at most {CAP}; after a fall {CAP}",
            scope=WHOLE),
    Measure("velocity_error_upright", "velocity error while upright", "m/s", "heading",
            f"<min(|e - v|, {CAP})>", "as error_vel of legged_gym and mjlab"),
    Measure("fall_after_push", "falls after a push", "", "",
            f"share of pushes that a fall follows within {pushes.MAX_TIME_TO_FALL:g} s and before the next"),
    Measure("energy", "energy", "J", "joints", "sum |P| h", ENERGY),
    Measure("positive_work", "positive work", "J", "joints", "sum max(P, 0) h", ENERGY),
    Measure("regeneration", "regeneration", "J", "joints", "sum max(-P, 0) h: work that the motors took up", ENERGY),
    Measure("joule_heat", "Joule heat", "J", "joints",
            "sum tau^2 / slope h, slope of the torque-speed curve K^2 / R; none of motors without a curve",
            f"Seok et al. 2015; {ENERGY}"),
    Measure("distance", "distance", "m", "heading", "sum |mean v| T of the command intervals"),
    Measure("cost_of_transport", "cost of transport", "", "",
            f"energy / (weight distance), of several episodes that of all together; none below a mean distance of "
            f"{effort.MIN_DISTANCE:g} m", f"Tucker 1975, with mechanical energy; {ENERGY}"),
    Measure("mechanical_power", "mechanical power", "W", "joints", "energy / time", ENERGY),
    Measure("peak_torque", "peak torque", "N·m", "joints", "max |tau| of all physics steps", ENERGY),
    Measure("mean_torque", "mean torque", "N·m", "joints", "<|tau|> of all physics steps", ENERGY),
    Measure("torque_share", "peak torque share", "", "joints",
            "max |tau| / limit of all physics steps, limit: the motor's largest torque", ENERGY),
    Measure("speed_share", "peak speed share", "", "joints",
            "max |dq/dt| / limit of all physics steps, limit: the motor's speed without load, or without a curve the "
            "rated one", ENERGY),
    Measure("torque_rate", "torque rate", "N·m/s", "joints",
            "<|T - T a control step before| / dt>, T: mean of tau over a control step; mean of the joints", ENERGY),
    Measure("overspeed", "joints above rated speed", "", "joints", "[|dq/dt| > rated speed] of joints and time"),
    Measure("action_rate", "action rate", "rad/s", "joints",
            "sqrt <((a - a one step before) / dt)^2>", "root mean square of legged_gym's action_rate"),
    Measure("foot_slip", "foot slip", "m/s", "world, horizontal",
            "path of the feet's centres while in contact / contact time; rolling of the foot included"),
    Measure("step_rate", "step rate", "1/s", "", f"touch-downs / (feet time); {FOOTFALL}", "Alexander & Jayes 1983"),
    Measure("touchdown_impulse", "touch-down impulse", "s", "ground normal",
            f"sum N h over {gait_quality.TOUCHDOWN_TIME:g} s / weight, from the start of the control step of a "
            f"touch-down on, N: force that presses the foot; mean of the touch-downs; {FOOTFALL}", ENERGY),
    Measure("flight", "flight", "", "", f"[no foot on the ground]; {FOOTFALL}", "Alexander & Jayes 1983"),
    Measure("trunk_height", "trunk height", "", "world, vertical",
            "<height of the trunk's centre above the terrain> / that of the home pose"),
    Measure("duty_factor", "duty factor", "", "", f"[foot on the ground], of each foot; {FOOTFALL}",
            "Alexander & Jayes 1983"),
    Measure("commands", "commands", "m/s, m/s, rad/s", "heading", "of each command interval"),
    Measure("mean_velocities", "mean velocities", "m/s, m/s, rad/s", "heading",
            "mean v of each command interval after its first second, if ended upright"),
    Measure("push_time", "time of each push", "s", "", "start to onset", scope=WHOLE),
    Measure("push_impulse", "impulse of each push", "N·s", "heading just before it", "force times duration",
            scope=WHOLE),
    Measure("push_fell", "fall after each push", "", "", "as falls after a push: 1 or 0"),
    Measure("cause", "cause", "", "", "why the episode failed: the first event by the rules of docs/causes.md",
            "rule causes/1", WHOLE),
    Measure("cause_time", "time of the cause", "s", "", "start to the control step in which it began", scope=WHOLE),
    Measure("cause_detail", "detail of the cause", "", "", "what decided, and whether it is certain or likely",
            scope=WHOLE),
)  # fmt: skip
"""Definitions of all measures, in the order of the fields of `evaluate.measures.metrics.Measures`."""

BY_NAME = {measure.name: measure for measure in MEASURES}
_LISTS = ("duty_factor", "commands", "mean_velocities")
OF_CAUSES = ("cause", "cause_time", "cause_detail")
"""Names of the measures that describe the cause of a failure; only failed episodes have them."""
FIGURES = tuple(
    name
    for name in BY_NAME
    if name not in ("outcome", "fell", "diverged", *_LISTS, *OF_CAUSES) and not name.startswith("push_")
)
"""Names of the measures that are one number per episode; outcomes, causes and measures of pushes are excluded."""
EFFORT = (
    *("cost_of_transport", "step_rate", "duty_factor", "trunk_height", "torque_share"),
    *("speed_share", "torque_rate", "touchdown_impulse", "flight"),
)
"""Names of the measures of motor effort and gait that tables show next to the success rate."""
