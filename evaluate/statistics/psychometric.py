"""Psychometric curve: the probability of a fall as a function of hardness, fitted to many data sets at once.

P(x) = γ + (1 − γ − λ) / (1 + exp(−s (x − m))): middle m, steepness s, floor γ of falls that no disturbance causes, and
lapse λ of episodes that the hardest leaves standing (Wichmann and Hill 2001, Perception & Psychophysics 63).

Fitted by maximum posterior, so that levels with no falls or only falls (complete separation) still give a finite curve:
γ, λ ~ Beta(1, 10), as in psignifit (Schütt et al. 2016, Vision Research 122); ln s ~ N(ln 5, 1.5²) and m ~ N(0, 2²) on
an axis scaled to −1 … 1 over the levels, so that s = 5 takes a robot from 1 % to 99 % within it and s > 0 holds always.
"""

import numpy as np

from evaluate.statistics.intervals import Floats

PRIOR_MEAN = np.array([0.0, np.log(5.0)])
PRIOR_PRECISION = np.array([2.0, 1.5]) ** -2.0
"""Prior mean and precision of m and ln s."""
UNDISTURBED = 9.0
"""b − 1 of the Beta(1, b) of floor and lapse."""
MOST_UNDISTURBED = 0.4
"""Bound of floor and lapse; half of the robots falling lies between them."""
STEPS = 40
CONVERGED = 1e-4
"""Gain in log posterior below which a fit is left alone."""


def fit(hardness: Floats, fall_rates: Floats, episodes: int, start: Floats | None = None) -> Floats:
    """Curves (r, 4) of m, ln s, γ, λ through fall rates (r, k) of that many episodes at each hardness (k,).

    Levenberg–Marquardt on the Fisher information, every data set with its own damping. Hardness is on the scaled axis;
    −inf is a level without any disturbance, where only the floor counts.
    """
    curves = np.empty((len(fall_rates), 4))
    curves[:] = _start(hardness, fall_rates) if start is None else start
    posterior = _log_posterior(curves, hardness, fall_rates, episodes)
    damping = np.full(len(curves), 1e-3)
    open_, diagonal = np.arange(len(curves)), np.arange(4)
    for _ in range(STEPS):
        now, rates = curves[open_], fall_rates[open_]
        gradient, information = _derivatives(now, hardness, rates, episodes)
        information[:, diagonal, diagonal] *= 1.0 + damping[open_, None]
        step = np.linalg.solve(information, gradient[:, :, None])[:, :, 0]
        tried = now + np.clip(step, -2.0, 2.0)
        tried[:, 2:] = tried[:, 2:].clip(0.0, MOST_UNDISTURBED)
        gained = _log_posterior(tried, hardness, rates, episodes) - posterior[open_]
        better = gained >= 0.0
        curves[open_[better]] = tried[better]
        posterior[open_[better]] += gained[better]
        damping[open_] = np.where(better, damping[open_] / 10.0, damping[open_] * 10.0).clip(1e-6, 1e6)
        open_ = open_[~(better & (gained < CONVERGED)) & (damping[open_] < 1e6)]
        if not len(open_):
            break
    return curves


def median_hardness(curves: Floats) -> Floats:
    """Hardness at which half of the episodes fall, (r,), floor and lapse counted."""
    m, steepness, floor, lapse = curves[:, 0], np.exp(curves[:, 1]), curves[:, 2], curves[:, 3]
    return np.asarray(m + np.log((0.5 - floor) / (0.5 - lapse)) / steepness)


def fall_probability(curves: Floats, hardness: Floats) -> Floats:
    """Probability of a fall by every curve at every hardness, (r, k)."""
    return _terms(curves, hardness)[0]


def _start(hardness: Floats, fall_rates: Floats) -> Floats:
    """The middle where the rates of the levels that fall less than half end, the rest as the prior has it."""
    known = hardness[np.isfinite(hardness)]
    edges = np.concatenate([[known[0]], (known[1:] + known[:-1]) / 2, [known[-1]]])
    milder = (fall_rates[:, np.isfinite(hardness)] < 0.5).sum(axis=1)
    return np.column_stack([edges[milder], np.full((len(fall_rates), 3), [PRIOR_MEAN[1], 0.01, 0.01])])


def _terms(curves: Floats, hardness: Floats) -> tuple[Floats, Floats, Floats]:
    """Probability, argument z and its logistic, (r, k) each."""
    z = (np.exp(curves[:, 1:2]) * (hardness - curves[:, :1])).clip(-40.0, 40.0)
    logistic = 1.0 / (1.0 + np.exp(-z))
    floor, lapse = curves[:, 2:3], curves[:, 3:4]
    return (floor + (1.0 - floor - lapse) * logistic).clip(1e-12, 1.0 - 1e-12), z, logistic


def _log_posterior(curves: Floats, hardness: Floats, fall_rates: Floats, episodes: int) -> Floats:
    probability = _terms(curves, hardness)[0]
    likelihood = fall_rates * np.log(probability) + (1.0 - fall_rates) * np.log1p(-probability)
    prior = -0.5 * (PRIOR_PRECISION * (curves[:, :2] - PRIOR_MEAN) ** 2).sum(axis=1)
    undisturbed = UNDISTURBED * np.log1p(-curves[:, 2:]).sum(axis=1)
    return np.asarray(episodes * likelihood.sum(axis=1) + prior + undisturbed)


def _derivatives(curves: Floats, hardness: Floats, fall_rates: Floats, episodes: int) -> tuple[Floats, Floats]:
    """Gradient (r, 4) and Fisher information (r, 4, 4) of the log posterior; bounds pushed against are fixed."""
    probability, z, logistic = _terms(curves, hardness)
    slope = (1.0 - curves[:, 2:3] - curves[:, 3:4]) * logistic * (1.0 - logistic)
    jacobian = np.stack([-np.exp(curves[:, 1:2]) * slope, z * slope, 1.0 - logistic, -logistic], axis=1)  # (r, 4, k)
    weighted = jacobian * (episodes / (probability * (1.0 - probability)))[:, None]
    gradient = (weighted @ (fall_rates - probability)[:, :, None])[:, :, 0]
    information = weighted @ jacobian.transpose(0, 2, 1)
    gradient[:, :2] -= PRIOR_PRECISION * (curves[:, :2] - PRIOR_MEAN)
    gradient[:, 2:] -= UNDISTURBED / (1.0 - curves[:, 2:])
    information[:, [0, 1], [0, 1]] += PRIOR_PRECISION
    information[:, [2, 3], [2, 3]] += UNDISTURBED / (1.0 - curves[:, 2:]) ** 2
    for i in (2, 3):
        low, high = curves[:, i] <= 0.0, curves[:, i] >= MOST_UNDISTURBED
        fixed = (low & (gradient[:, i] < 0.0)) | (high & (gradient[:, i] > 0.0))
        gradient[fixed, i] = 0.0
        information[fixed, i, :] = information[fixed, :, i] = 0.0
        information[fixed, i, i] = 1.0
    return gradient, information
