"""The prior of a configured value: right within some percent, or wrong by any factor."""

from __future__ import annotations

from ..arrays import FloatArray


def combine(
    log_ratio: FloatArray, precision: FloatArray, scale: float
) -> tuple[FloatArray, FloatArray]:
    """Return the log ratio of a learned value to the configured one, and its precision.

    Parameters
    ----------
    log_ratio : array
        As the data show it.
    precision : array
        Inverse of its variance; 0 without data.
    scale : float
        Scale of the prior.

    Notes
    -----
    The prior is a Cauchy distribution about 0, which leaves small differences alone until they are
    certain, and follows large ones at once. As a scale mixture of normal distributions it has the
    precision 2 / (s^2 + x^2) at a log ratio x.
    """
    prior = 2.0 / (scale**2 + log_ratio**2)
    total = precision + prior
    return log_ratio * precision / total, total
