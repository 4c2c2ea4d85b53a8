"""The metrics, each with its accumulator."""

from .consistency import Consistency
from .distances import (
    Classes,
    GospaAccumulator,
    Heights,
    Nearness,
    Numbers,
    OspaAccumulator,
    Pairs,
    Space,
)
from .tracks import Gaps, Ospa2Accumulator, Switches

# All accumulators, in the order of tables and keys.
ACCUMULATORS = (
    OspaAccumulator,
    GospaAccumulator,
    Numbers,
    Pairs,
    Gaps,
    Consistency,
    Ospa2Accumulator,
    Switches,
    Nearness,
    Heights,
    Space,
    Classes,
)
