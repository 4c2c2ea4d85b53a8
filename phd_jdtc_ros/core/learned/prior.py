"""The prior of a configured value: right within some percent, or wrong by any factor."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import FloatArray


@dataclass(frozen=True)
class RatioPrior:
    """Prior of the log ratio of a learned value to the configured one.

    The prior is a mixture of two normal distributions. The posterior stays at the configured value
    if chance explains the difference, and otherwise follows the data immediately. The likelihood of
    the data is normal, so that the posterior is such a mixture too.
    """

    right: float  # Probability that the configured value is right
    scale: float  # Standard deviation of the log ratio about 0, if it is right
    wide: float  # Standard deviation of the log ratio about 0, if it is wrong

    @cached_property
    def _components(self) -> tuple[FloatArray, FloatArray]:
        """Log weights and variances of both normal distributions, (2, 1)."""
        share, std = np.array([[self.right], [1.0 - self.right]]), (self.scale, self.wide)
        return np.log(share), np.array([[component_std**2] for component_std in std])

    def posterior(
        self, log_ratio: FloatArray, precision: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the mean and the variance of K log ratios, (K,).

        `log_ratio` has those that the data show, and `precision` the inverses of their variances; 0
        without data.
        """
        log_share, square = self._components
        # Variance of the shown log ratio relative to that of its error.
        spread = 1.0 + precision * square
        weight = log_share - 0.5 * np.log(spread) - 0.5 * precision * log_ratio**2 / spread
        right, wrong = log_ratio * (1.0 - 1.0 / spread)
        of_scale, of_wide = square / spread
        share = 1.0 / (1.0 + np.exp(np.minimum(weight[0] - weight[1], 500.0)))
        mean = right + share * (wrong - right)
        between = share * (1.0 - share) * (wrong - right) ** 2
        return mean, of_scale + share * (of_wide - of_scale) + between
