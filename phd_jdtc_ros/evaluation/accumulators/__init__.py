"""The metrics, each with its accumulator."""

from .consistency import Consistency
from .distances import GospaOfScan, Numbers, OspaOfScan
from .gaps import Gaps
from .identity import Switches
from .pairs import Classes, Heights, Nearness, Pairs
from .tracks import Ospa2OfRun

# All accumulators, in the order of tables and keys.
ACCUMULATORS = (
    OspaOfScan,
    GospaOfScan,
    Numbers,
    Pairs,
    Gaps,
    Consistency,
    Ospa2OfRun,
    Switches,
    Nearness,
    Heights,
    Classes,
)
