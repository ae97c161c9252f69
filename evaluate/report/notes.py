"""How the figures were made: what a reader has to know before believing them."""

from evaluate.analysis.breaking_points import CAVEAT
from evaluate.analysis.results import Results
from evaluate.measures.outcomes import SUCCESS_RULE
from quad_env.cli.format import counted, listed

NOTES = (
    "Every policy runs the same episodes: the same seeds, and so the same starts, commands, pushes and places on the "
    "terrain. They come from a family of seeds that training and parameter searches never draw from.",
    "Velocity and yaw-rate error are means over the control steps after an episode's first second, in the heading "
    "frame. A step's error is capped at 2 m/s and 3 rad/s, and every step from a fall to the time limit is "
    "assigned the cap, so that a fall never improves an error.",
    "Mean velocity error compares the command with the mean velocity over each command interval after its first "
    "second, so that swaying within a stride does not count. After a fall it is the cap too.",
    "A divergence of the simulation counts as a fall. A time-out does not.",
    "Cost of transport is the energy of all episodes, ∑|torque · joint speed| before a fall, over weight times "
    "distance, where the distance of a command interval is its time times its mean planar speed: swaying on the spot "
    "covers none.",
    "Intervals are 95 %: Wilson for successes and falls, for scores Wilson with the effective number of episodes (Korn "
    "and Graubard 1998), bootstrap (BCa) over episodes for means, Tango's score interval for differences of successes "
    "and falls, bootstrap over pairs (percentiles, widened to Student's t) for those of means. Where all episodes "
    "agree, others may have the share that Wilson's interval has for none of so many, and any value up to the cap.",
    "Tests are paired by episode and two-sided: exact McNemar for falls, sign-flip permutation for means. p-values are "
    "corrected by Holm's method, metric by metric, over the comparisons with the baseline on every scenario of the "
    "run; those of the other pairs are families of their own. A difference is claimed below 0.05: the chance of any "
    "false claim in a family is then at most 5 %. Where none is claimed there may still be one that so many episodes "
    "cannot show.",
    "A breaking point is where half of the episodes fail, that is fall or do not succeed: where a monotone regression, "
    "straight over the logarithm of severity between the levels, crosses one half. No shape is assumed. "
    f"{CAVEAT} What fewer and more are is shown by exact binomial tests.",
    "The intervals speak of episodes, not of training: another training seed gives another policy.",
)


def warnings(results: Results) -> list[str]:
    """What a reader has to know first: policies with errors, and outcomes by an older rule of success."""
    lines = [
        f"{each.policy} failed in {each.failed} of {counted(each.episodes, 'episode')}; in the first it {each.first}"
        for each in results.policy_errors
    ]
    if results.success_rule != SUCCESS_RULE:
        lines.append(
            f"Success is by the older rule {results.success_rule}, under which these episodes ran: standing still can "
            f"succeed at slow commands. python -m research rescore applies {SUCCESS_RULE} to an evaluation with traces"
        )
    return lines


def extent(results: Results) -> str:
    """`64 episodes of each policy on each of 27 scenarios, of document on flat alone`."""
    ran = {policy: [name for name, other in results.summaries if other == policy] for policy in results.policies}
    fewer = {policy: names for policy, names in ran.items() if len(names) < len(results.scenarios)}
    alone = [f"of {policy} on {listed(names)} alone" for policy, names in fewer.items() if results.complete]
    scenarios = counted(len(results.scenarios), "scenario")
    return ", ".join([f"{counted(results.episodes, 'episode')} of each policy on each of {scenarios}", *alone])
