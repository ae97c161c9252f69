"""One-line summaries of the policies that ship with the project, for listings and documentation."""

SUMMARIES = {
    "stand": "holds the home pose",
    "crouch": "holds a lower pose with bent knees; end-to-end learning starts from it",
    "document": "the article's controller as printed; collapses, because its axis conventions contradict its model",
    "document_repaired": "the article's controller with repaired axes and inverse kinematics; ignores commands",
    "trot": "open-loop diagonal trot with commanded velocity; the baseline",
    "trot_integral": "trot with integral feedback of the velocity error, against slopes and steady forces",
    "trot_feedback": "slow, upright trot by virtual model control: springs and dampers on the trunk",
    "trot_reference": "upright trot on compliant servos with integral feedback; base of learned policies",
    "walk": "four-beat walk with three feet on the ground; at most 0.4 m/s forward",
    "pace": "the legs of one side move together; at most 0.8 m/s forward",
    "bound": "fore legs, then hind legs; at most 0.8 m/s forward",
    "pronk": "all four legs move together; at most 0.56 m/s forward",
    "gaits": (
        'any of these gaits, the trot or standing, per robot; starts as the trot; request("walk", mask) changes the '
        "gait while walking"
    ),
    "behaviour": "state machine: stand, walk, run, jump, fall, recover",
    "mpc": "model-predictive control of a trot; joint torques leg by leg",
    "mpc_wbc": "model-predictive control of a trot with a whole-body quadratic program",
    "mpc_wbc_sighted": "mpc_wbc that also observes a height scan",
    "mpc_wbc_walk": "walk by mpc_wbc",
    "mpc_wbc_pace": "pace by mpc_wbc",
    "mpc_wbc_bound": "bound by mpc_wbc, with a flight phase",
    "mpc_wbc_pronk": "pronk by mpc_wbc, with a flight phase",
    "residual": "learned correction of a trot: of trot_integral on SimpleQuad, of trot_reference on go1 and go2",
    "robust": "residual with six times as many training steps",
    "end_to_end": "learned without a gait, from a pose; shows the value of residual's base",
}
"""Name of every policy that ships with the project -> its summary in one line.

`python -m quad_env policies` and docs/policies.md list the policies in this order."""
