"""Distances and consistency in space, where the estimates are in space and heights are true."""

from __future__ import annotations

import numpy as np

from phd_jdtc_ros.core.arrays import FloatArray

from ..accumulator import SPACE, Accumulator, Metric, Values, mean, share
from ..comparison import Comparison, are_in_space
from ..metrics import gospa, ospa

# Number of axes: position and velocity in space.
AXES = 6


class Space(Accumulator):
    """OSPA and GOSPA of positions in space, and the NEES of six axes; for all targets only."""

    names = ("ospa_3d", "gospa_3d", "judged_in_space", "nees_3d_sum")
    metrics = (
        Metric(
            key="ospa_3d",
            heading="OSPA in space",
            unit="m",
            form=".1f",
            of_run=mean("ospa_3d"),
            definition=(
                "The OSPA distance of positions with heights, in scans whose estimates are in "
                "space and whose true heights are known. An estimate whose height is unknown is "
                "as far as c from every target."
            ),
            group=SPACE,
        ),
        Metric(
            key="gospa_3d",
            heading="GOSPA in space",
            unit="m",
            form=".1f",
            of_run=mean("gospa_3d"),
            definition="The GOSPA distance of the same positions.",
            group=SPACE,
        ),
        Metric(
            key="nees_3d",
            heading="NEES in space",
            unit="",
            form="#.3g",
            of_run=share("nees_3d_sum", "judged_in_space"),
            definition=(
                "Normalised estimation error squared of position and velocity in space, divided "
                "by 6: the mean over the pairs with known heights and climb rates. It is 1 if the "
                "covariances are right, and larger if they are too small."
            ),
            group=SPACE,
        ),
    )

    def values(self, part: Comparison) -> Values:
        """Return both distances, the number of pairs with a NEES, and its sum."""
        if not (part.whole and are_in_space(part.truth, part.estimate)):
            return (None, None, 0, 0.0) if part.whole else (None,) * len(self.names)
        # Beyond the cutoff all places are alike.
        far = np.full((len(part.estimate), 3), 1e3 * self.cutoff + 1e9)
        place = part.estimate.place
        found = np.where(np.isnan(place).any(axis=1, keepdims=True), far, place)
        parameters = part.truth.place, found, self.cutoff, self.order
        squares = _squares(part)
        return (
            ospa(*parameters).distance,
            gospa(*parameters).distance,
            len(squares),
            float(squares.sum()) / AXES,
        )


def _squares(part: Comparison) -> FloatArray:
    """Return the squared Mahalanobis distances of the pairs that are known in all axes."""
    true, found = part.paired_truth, part.paired_estimate
    covariance = found.space_covariance
    error = np.concatenate([found.place - true.place, found.motion - true.motion], axis=1)
    if covariance is None:
        return np.zeros(0)
    known = np.isfinite(error).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    error, covariance = error[known], covariance[known]
    sound = np.linalg.eigvalsh(covariance).min(axis=1, initial=1.0) > 0.0
    solved = np.linalg.solve(covariance[sound], error[sound][..., None])[..., 0]
    squares: FloatArray = (solved * error[sound]).sum(axis=1)
    return squares
