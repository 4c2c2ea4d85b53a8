"""The metrics, each with its accumulator."""

from .consistency import Consistency
from .distances import GospaAccumulator, Numbers, OspaAccumulator
from .gaps import Gaps
from .identity import Switches
from .pairs import Classes, Heights, Nearness, Pairs
from .space import Space
from .tracks import Ospa2Accumulator

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
