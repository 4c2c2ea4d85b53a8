"""OSPA, GOSPA and the number of targets."""

from __future__ import annotations

from ..accumulator import GOSPA, OSPA, Accumulator, Metric, Values, mean
from ..comparison import Comparison
from ..metrics import gospa, ospa


class OspaAccumulator(Accumulator):
    """The OSPA distance and its parts."""

    names = published = ("ospa", "localization", "cardinality")
    curves = ("ospa", "localization")
    metrics = (
        Metric(
            key="ospa",
            heading="OSPA",
            unit="m",
            form=".1f",
            of_run=mean("ospa"),
            definition=(
                "Mean over the scans of the optimal sub-pattern assignment distance between the "
                "estimated and the true positions of a scan. Estimates and targets are paired so "
                "that the sum of the p-th powers of their distances, each cut off at c, is least. "
                "A missed or false target counts as a distance of c. The OSPA distance is the mean "
                "of these powers over the larger set, to the power 1/p. It is 0 if both sets are "
                "empty and c if only one is."
            ),
            group=OSPA,
        ),
        Metric(
            key="localization",
            heading="localisation",
            unit="m",
            form=".1f",
            of_run=mean("localization"),
            definition=(
                "The part of the OSPA distance due to the position errors of the pairs. The p-th "
                "powers of the two parts add up to that of the distance in every scan; the parts "
                "themselves add only for p = 1."
            ),
            group=OSPA,
        ),
        Metric(
            key="cardinality",
            heading="cardinality",
            unit="m",
            form=".1f",
            of_run=mean("cardinality"),
            definition="The part of the OSPA distance due to the wrong number of targets.",
            group=OSPA,
        ),
    )

    def values(self, part: Comparison) -> Values:
        """Return the distance and its parts."""
        found = ospa(part.truth.position, part.estimate.position, self.cutoff, self.order)
        return found.distance, found.localization, found.cardinality


class GospaAccumulator(Accumulator):
    """The GOSPA distance and its parts."""

    names = published = ("gospa", "gospa_localization", "missed", "false")
    metrics = (
        Metric(
            key="gospa",
            heading="GOSPA",
            unit="m",
            form=".1f",
            of_run=mean("gospa"),
            definition=(
                "Mean over the scans of the generalised OSPA distance (alpha = 2) with the same p "
                "and c. It is not divided by the number of targets, and every missed and every "
                "false target costs c / 2^(1/p)."
            ),
            group=GOSPA,
        ),
        Metric(
            key="gospa_localization",
            heading="localisation",
            unit="m",
            form=".1f",
            of_run=mean("gospa_localization"),
            definition=(
                "The part of the GOSPA distance due to the position errors of the pairs; it is not "
                "divided by their number."
            ),
            group=GOSPA,
        ),
        Metric(
            key="missed",
            heading="missed",
            unit="",
            form=".3f",
            of_run=mean("missed"),
            definition="Mean number per scan of targets that GOSPA pairs with no estimate.",
            group=GOSPA,
        ),
        Metric(
            key="false",
            heading="false",
            unit="",
            form=".3f",
            of_run=mean("false"),
            definition="Mean number per scan of estimates that GOSPA pairs with no target.",
            group=GOSPA,
        ),
    )

    def values(self, part: Comparison) -> Values:
        """Return the distance and its parts."""
        found = gospa(part.truth.position, part.estimate.position, self.cutoff, self.order)
        return found.distance, found.localization, found.missed, found.false


class Numbers(Accumulator):
    """The numbers of targets and of estimates."""

    names = ("n_true", "n_est", "cardinality_abs_error")
    published = curves = ("n_true", "n_est")
    metrics = (
        Metric(
            key="cardinality_abs_error",
            heading="number error",
            unit="",
            form=".3f",
            of_run=mean("cardinality_abs_error"),
            definition=(
                "Mean over the scans of the absolute difference between the number of estimates "
                "and the number of targets."
            ),
            group=OSPA,
        ),
    )

    def values(self, part: Comparison) -> Values:
        """Return both numbers and their absolute difference."""
        true, estimated = len(part.truth), len(part.estimate)
        return true, estimated, abs(estimated - true)
