"""The prior of a configured value: right within some percent, or wrong by any factor."""

from __future__ import annotations

from typing import NamedTuple

from ..arrays import FloatArray

# Log likelihood ratio from which a change of a learned value is reported, and its upper bound. For
# a sensor that is as before, or whose change has been learned, it falls from one to the other in
# about ten revolutions.
RAISED, MOST_EVIDENCE = 12.0, 24.0


class RatioPrior(NamedTuple):
    """Prior of the log ratio of a learned value to the configured one.

    The prior is a mixture of two normal distributions. The posterior stays at the configured value
    if chance explains the difference, and otherwise follows the data immediately. The likelihood of
    the data is normal, so that the posterior is such a mixture too.
    """

    right: float  # Probability that the configured value is right
    scale: float  # Standard deviation of the log ratio about 0, if it is right
    wide: float  # Standard deviation of the log ratio about 0, if it is wrong

    def posterior(
        self, log_ratio: FloatArray, precision: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the mean and the variance of K log ratios, (K,).

        `log_ratio` has those that the data show, and `precision` the inverses of their variances; 0
        without data.
        """
        from .loops import mixture_posterior

        mean, variance = mixture_posterior(*self, log_ratio, precision)
        return mean, variance
