"""Evidence on a sensor's noise from one innovation; compiled, so that only engines load it."""

from __future__ import annotations

from scipy.special import chdtr

from ...compilation import inner

# Innovations are limited to this many standard deviations, so that outliers do not raise the noise.
MOST_SIGMA = 3.0
# Innovations with a smaller share of the sensor's noise in their variance do not count: they would
# show the motion's errors.
LEAST_NOISE_SHARE = 0.25
LIMIT = MOST_SIGMA**2


def limited_mean(variance: float) -> float:
    """Return the mean of the limited squares of normal variables of this variance."""
    limit = LIMIT / variance
    return float(variance * chdtr(3.0, limit) + LIMIT * (1.0 - chdtr(1.0, limit)))


LIMITED_MEAN = limited_mean(1.0)


@inner
def evidence_of(square: float, noise_share: float) -> tuple[float, float]:
    """Return the weight of an innovation, and the weight times the ratio of variances minus 1.

    `square` is the square of a component of an innovation, relative to its expected value.
    `noise_share` is the share of the sensor's variance R in the expected value; NaN if the
    detection has a noise of its own.

    In one dimension the innovation v has the variance S = H P H' + R; `square` is v^2 / S, and
    `noise_share` is R / S. v^2 - H P H' has the mean R, whichever R was assumed. Its variance is
    2 S^2, so that its weight is the square of `noise_share`. In more dimensions w = S^-1 v has the
    variances (S^-1)_ii; `square` is w_i^2 / (S^-1)_ii, and `noise_share` is R_ii (S^-1)_ii.

    References
    ----------
    Mehra, "On the identification of variances and adaptive Kalman filtering", IEEE Transactions on
    Automatic Control 15(2), 1970.
    """
    if noise_share > LEAST_NOISE_SHARE:  # False for NaN
        return noise_share * noise_share, noise_share * (min(square, LIMIT) / LIMITED_MEAN - 1.0)
    return 0.0, 0.0
