"""`planning` and `frontier`, compiled by numba; see `core.numba_loops`."""

from __future__ import annotations

from ..numba_loops import called, compiled, types
from . import clusters, frontier, planning

_FLOATS, _INTS = types.float64[::1], types.int64[::1]
_GRAPH = types.NamedUniTuple(_INTS, len(clusters.Graph._fields), clusters.Graph)
_PLAN = types.NamedUniTuple(_INTS, len(planning.Plan._fields), planning.Plan)

called(planning._opened)
called(frontier._before)
called(frontier._after)
for _plain, _loops in frontier.LOOPS.items():
    called(_plain, _loops)
plan = compiled(_PLAN(_GRAPH, types.int64))(planning.plan)
prices = compiled(_FLOATS(_GRAPH, _FLOATS))(frontier.prices)
sums = compiled(types.UniTuple(_FLOATS, 2)(_PLAN, _FLOATS, _FLOATS))(frontier.sums)
