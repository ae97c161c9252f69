"""What each policy is, in a line, by its name; `python -m quad_env policies` and docs/policies.md say it."""

from collections.abc import Iterable

SUMMARIES = {
    "stand": "holds the home pose",
    "crouch": "holds a lower one, knees bent: what end-to-end learning begins from",
    "document": "the article's controller as printed; it collapses by its axis conventions and is there to be seen",
    "document_repaired": "the printed parameters with only the repairs the geometry needs; takes no command",
    "trot": "a diagonal trot that follows the command; the baseline",
    "trot_integral": (
        "the trot whose command is corrected by the integral of its velocity error: what lasts, a slope or a steady "
        "force, does not carry it off"
    ),
    "trot_feedback": (
        "a slow, upright trot by virtual model control: the trunk on springs and dampers that the standing feet bear, "
        "and footholds from the velocity error"
    ),
    "trot_reference": "an upright trot on compliant servos with the velocity error's integral, for learned policies",
    "walk": "four beats, three feet on the ground; follows the command within its limit of 0.4 m/s ahead",
    "pace": "the legs of one side together; at most 0.8 m/s ahead",
    "bound": "the fore legs together, then the hind legs; at most 0.8 m/s ahead",
    "pronk": "all four legs together; at most 0.56 m/s ahead",
    "gaits": (
        'any of these gaits, the trot or standing, robot by robot; starts as the trot; request("walk", mask) changes '
        "the gait under way"
    ),
    "behaviour": "states (stand, walk, run, jump, fall, recover) and one table of transitions",
    "mpc": "model-predictive control of a trot; joint torques are computed leg by leg",
    "mpc_wbc": "mpc with a quadratic program of the whole body",
    "mpc_wbc_sighted": "mpc_wbc that is shown a height scan, which no other policy is",
    "mpc_wbc_walk": "mpc_wbc's walk",
    "mpc_wbc_pace": "mpc_wbc's pace",
    "mpc_wbc_bound": "mpc_wbc's bound, with a flight",
    "mpc_wbc_pronk": "mpc_wbc's pronk, with a flight",
    "residual": "a learned correction of a trot: of trot_integral on SimpleQuad, of trot_reference on go1 and go2",
    "robust": "the same as residual, trained for six times as long",
    "end_to_end": "learned without a gait, from a crouch, by up to 1 rad a joint: what the base of residual is worth",
}
"""Of every policy that ships, in the order in which they are listed."""


def explained(names: Iterable[str]) -> dict[str, str]:
    """Those of the names, in their order, that need explaining before their figures: policies that ship."""
    return {name: SUMMARIES[name] for name in names if name in SUMMARIES}
