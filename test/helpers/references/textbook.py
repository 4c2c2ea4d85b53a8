"""Kalman filters and smoothers as textbooks have them, one target and one matrix at a time.

They share nothing with the engine but the models' functions of motion and noise.
"""

from dataclasses import dataclass

import numpy as np

ITERATIONS = 5
PLACE, SPEED = [0, 2], [1, 3]


@dataclass(frozen=True)
class Normal:
    """A distribution; its mode probability and log evidence where they matter."""

    mean: np.ndarray
    covariance: np.ndarray


def initial(motion, mean, std):
    """Return the distribution with a mean and deviations, on the axes of a motion."""
    inside = np.isin(np.arange(len(mean)), motion.support)
    return Normal(np.where(inside, mean, 0.0), np.diag(np.where(inside, std, 0.0) ** 2))


def straight(seconds, size):
    """Return the matrix of a flight straight on; the turn rate stays."""
    matrix = np.eye(size)
    matrix[PLACE, SPEED] = seconds
    return matrix


def linearised(radar, mean):
    """Return what a radar measures of a state, and the derivatives, shapes (2,) and (2, D)."""
    east, north = mean[PLACE] - np.array(radar.position)
    distance = np.hypot(east, north)
    expected = np.array([distance, np.arctan2(north, east) - radar.yaw])
    matrix = np.zeros((2, len(mean)))
    matrix[:, PLACE] = [
        [east / distance, north / distance],
        [-north / distance**2, east / distance**2],
    ]
    return expected, matrix


def update(prior, radar, measurement, seconds=0.0, std=None, iterations=ITERATIONS):
    """Return the posterior, and the log likelihood of the measurement linearised last.

    The state is moved to the time of the plot, updated there, and moved back.
    """
    noise = np.diag(np.square(radar.noise_std if std is None else std))
    moving = straight(seconds, len(prior.mean))
    mean, covariance = moving @ prior.mean, moving @ prior.covariance @ moving.T
    at = mean
    for _ in range(iterations):
        expected, seen = linearised(radar, at)
        error = measurement - expected
        error[1] = np.arctan2(np.sin(error[1]), np.cos(error[1]))
        error = error - seen @ (mean - at)
        spread = seen @ covariance @ seen.T + noise
        gain = covariance @ seen.T @ np.linalg.inv(spread)
        at = mean + gain @ error
    kept = np.eye(len(mean)) - gain @ seen
    posterior = kept @ covariance @ kept.T + gain @ noise @ gain.T
    square = error @ np.linalg.solve(spread, error)
    log_likelihood = -0.5 * square - 0.5 * np.log(np.linalg.det(2.0 * np.pi * spread))
    back = straight(-seconds, len(mean))
    return Normal(back @ at, back @ posterior @ back.T), log_likelihood


def grid(*points):
    """Return the nodes and the weights of a quadrature over standard normal axes."""
    rules = [np.polynomial.hermite_e.hermegauss(count) for count in points]
    nodes = np.meshgrid(*[node for node, _ in rules], indexing="ij")
    weights = np.meshgrid(*[weight / weight.sum() for _, weight in rules], indexing="ij")
    return np.stack([axis.ravel() for axis in nodes], axis=1), np.prod(weights, axis=0).ravel()


# The filter of Gauss and Hermite, of the fifth order in the turn rate, which comes first. The
# motion is linear in the other axes, for which the third order is exact.
TURN_FIRST = [4, 0, 1, 2, 3, 5, 6]
NODES, WEIGHTS = grid(5, 3, 3, 3, 3, 3, 3)


def predict(before, motion, dt):
    """Return the prediction of one motion, and the gain that leads back from it.

    The moments are those of the motion of every node of a grid over the whole state.
    """
    size = len(before.mean)
    order = TURN_FIRST[:size]
    std = np.sqrt(np.diag(before.covariance))[order]
    ordered = before.covariance[np.ix_(order, order)]
    unit = np.where(std > 0.0, std, 1.0)
    correlation = ordered / (unit[:, None] * unit) + np.diag((std == 0.0).astype(float))
    apart = np.empty((len(NODES), size))
    apart[:, order] = NODES[:, :size] @ (std[:, None] * np.linalg.cholesky(correlation)).T
    moved = motion.mean(before.mean + apart, dt)
    mean = WEIGHTS @ moved
    cross = (apart * WEIGHTS[:, None]).T @ (moved - mean)
    support = np.ix_(motion.support, motion.support)
    covariance = ((moved - mean) * WEIGHTS[:, None]).T @ (moved - mean)
    covariance[support] += motion.noise_covariance(dt)
    # The cross-covariance times the inverse of the predicted covariance.
    gain = np.zeros((size, size))
    gain[:, motion.support] = np.linalg.solve(covariance[support], cross[:, motion.support].T).T
    return Normal(mean, covariance), gain


def smooth(before, later, gain, smoothed):
    """Return the earlier distribution, given the smoothed later one: Rauch, Tung, Striebel."""
    return Normal(
        before.mean + gain @ (smoothed.mean - later.mean),
        before.covariance + gain @ (smoothed.covariance - later.covariance) @ gain.T,
    )


def mixed(shares, parts):
    """Return the mean and covariance of a mixture."""
    mean = sum(share * part.mean for share, part in zip(shares, parts, strict=True))
    covariance = np.zeros((5, 5))
    for share, part in zip(shares, parts, strict=True):
        apart = part.mean - mean
        covariance += share * (part.covariance + np.outer(apart, apart))
    return Normal(mean, covariance)


@dataclass(frozen=True)
class Step:
    """One scan of a filter of interacting multiple models, by motion mode.

    `pairs` has, for each earlier and later mode, the probability of both, the distribution that is
    predicted, and the gain that leads back from it.
    """

    probability: np.ndarray
    modes: list
    pairs: list


def first_step(probability, modes):
    return Step(np.asarray(probability), modes, [])


def imm(before, motions, transition, dt, reports):
    """Return the next step: Blom and Bar-Shalom's filter, with every pair moved before it is mixed.

    `reports` are (radar, measurement, seconds) of the target, in the order of the updates.
    """
    count = range(len(motions))
    pairs = [
        [
            (before.probability[i] * transition[i, j], *predict(before.modes[i], motions[j], dt))
            for j in count
        ]
        for i in count
    ]
    probability = before.probability @ transition
    modes = [
        mixed([pairs[i][j][0] / probability[j] for i in count], [pairs[i][j][1] for i in count])
        for j in count
    ]
    for radar, measurement, seconds in reports:
        log_likelihood = np.zeros(len(motions))
        for j in count:
            modes[j], log_likelihood[j] = update(modes[j], radar, measurement, seconds)
        probability = probability * np.exp(log_likelihood - log_likelihood.max())
        probability = probability / probability.sum()
    return Step(probability, modes, pairs)


def log_normal(point, distribution, support):
    """Return the log density of a point, without its constant."""
    axes = np.ix_(support, support)
    apart = (point - distribution.mean)[list(support)]
    covariance = distribution.covariance[axes]
    square = apart @ np.linalg.solve(covariance, apart)
    return -0.5 * (square + np.linalg.slogdet(covariance)[1])


def imm_backward(before, later, smoothed, motions):
    """Return the smoothed (probability, modes) of a step, given those of the next one.

    Barber's expectation correction: the later mode's mean weighs the earlier modes.
    """
    probability, modes = smoothed
    count = range(len(motions))
    joint = np.zeros((len(motions), len(motions)))
    for j, motion in enumerate(motions):
        log_fit = np.array(
            [log_normal(modes[j].mean, later.pairs[i][j][1], motion.support) for i in count]
        )
        fit = np.exp(log_fit - log_fit.max())
        share = np.array([later.pairs[i][j][0] for i in count]) * fit
        joint[:, j] = probability[j] * share / share.sum()
    earlier = []
    for i in count:
        parts = [smooth(before.modes[i], *later.pairs[i][j][1:], modes[j]) for j in count]
        earlier.append(mixed(joint[i] / joint[i].sum(), parts))
    return joint.sum(axis=1), earlier


def imm_smoothed(steps, motions):
    """Return the (probability, modes) of the first step, given all of them."""
    smoothed = steps[-1].probability, steps[-1].modes
    for before, later in zip(steps[-2::-1], steps[:0:-1], strict=True):
        smoothed = imm_backward(before, later, smoothed, motions)
    return smoothed


def kalman_smoother(mean, covariance, points, noises, transition, process):
    """Return filtered and smoothed means and covariances of a linear Gaussian model."""
    select = np.eye(4)[[0, 2]]
    filtered, predicted = [], []
    for index, (point, noise) in enumerate(zip(points, noises, strict=True)):
        if index:
            mean = transition @ mean
            covariance = transition @ covariance @ transition.T + process
        predicted.append((mean, covariance))
        gain = covariance @ select.T @ np.linalg.inv(select @ covariance @ select.T + noise)
        mean = mean + gain @ (point - select @ mean)
        covariance = covariance - gain @ select @ covariance
        filtered.append((mean, covariance))
    smoothed = [filtered[-1]]
    for index in range(len(points) - 2, -1, -1):
        mean, covariance = filtered[index]
        ahead_mean, ahead_covariance = predicted[index + 1]
        gain = covariance @ transition.T @ np.linalg.inv(ahead_covariance)
        mean = mean + gain @ (smoothed[-1][0] - ahead_mean)
        covariance = covariance + gain @ (smoothed[-1][1] - ahead_covariance) @ gain.T
        smoothed.append((mean, covariance))
    return filtered, smoothed[::-1]
