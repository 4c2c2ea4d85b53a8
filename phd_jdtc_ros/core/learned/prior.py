"""The prior of a configured value: right within some percent, or wrong by any factor."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arrays import FloatArray


class RatioPrior(NamedTuple):
    """Prior of the log ratio of a learned value to the configured one.

    The prior is a mixture of two normal distributions. The posterior stays at the configured value
    if chance explains the difference, and otherwise follows the data at once. The likelihood of the
    data is normal, so that the posterior is such a mixture too.
    """

    right: float  # Probability that the configured value is right
    scale: float  # Standard deviation of the log ratio about 0, if it is right
    wide: float  # Standard deviation of the log ratio about 0, if it is wrong

    def posterior(
        self, log_ratio: FloatArray, precision: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the mean and the variance of log ratios, elementwise.

        Given are the log ratio that the data show, and the inverse of its variance; 0 without data.
        """
        evidence = log_ratio, precision
        of_right, right, of_scale = _posterior(self.right, self.scale, *evidence)
        of_wrong, wrong, of_wide = _posterior(1.0 - self.right, self.wide, *evidence)
        share = 1.0 / (1.0 + np.exp(np.minimum(of_right - of_wrong, 500.0)))
        mean = right + share * (wrong - right)
        apart = share * (1.0 - share) * (wrong - right) ** 2
        return mean, of_scale + share * (of_wide - of_scale) + apart


def _posterior(
    share: float, std: float, log_ratio: FloatArray, precision: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the log weight, the mean and the variance of one of the normal distributions."""
    # Variance of the shown log ratio relative to that of its error.
    spread = 1.0 + precision * std**2
    weight = np.log(share) - 0.5 * np.log(spread) - 0.5 * precision * log_ratio**2 / spread
    return weight, log_ratio * (1.0 - 1.0 / spread), std**2 / spread
