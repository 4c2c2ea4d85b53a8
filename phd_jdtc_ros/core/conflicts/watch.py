"""Watches the tracks of an engine for conflicts, step by step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..engine import Engine
from ..tracks.manual import Manual
from ..types import TENTATIVE, Estimates, Pose
from .alarms import Alarms
from .encounters import Named, predict
from .model import ConflictModel, Conflicts, words


class Watch:
    """Predicts the conflicts after a step, if a computation is due, and raises alarms.

    The paths are drawn from a generator that depends on the stamp alone, so that a recording has
    the conflicts that were found live.
    """

    def __init__(self, model: ConflictModel) -> None:
        self.model = model
        self.begin_run()

    def begin_run(self) -> None:
        """Forget all encounters."""
        self.alarms = Alarms(self.model.alarms_per_hour)
        self.latest: Conflicts | None = None
        self._targets: Estimates | None = None

    def step(
        self,
        stamp_ns: int,
        filtered: Sequence[Estimates],
        engine: Engine,
        own: Pose | None,
        manual: Manual,
    ) -> tuple[Conflicts, list[str]] | None:
        """Return the conflicts at the stamp of the engine's last scan, and new alarms in words.

        None if none are due. `filtered` are the estimates of the step, and `own` is own ship's
        pose; one without a velocity has no conflicts. Without it, the track that is marked as own
        ship is own ship. Friends are in no conflict with each other.
        """
        # Only what is reported can be in a conflict, and estimates need not come with every scan.
        self._targets = targets = filtered[-1] if filtered else self._targets
        before_ns = None if self.latest is None else self.latest.stamp_ns
        if before_ns is not None and 0 <= stamp_ns - before_ns < self.model.period_s * 1e9:
            return None
        if targets is None or not self.model.enabled:
            return None
        reported = targets.select((targets.track_state != TENTATIVE) & (targets.track_id > 0))
        rng = np.random.default_rng(stamp_ns)
        model = self.model
        drawn = reported.track_id, model.interval_s, model.steps, model.paths, rng
        paths = engine.paths(*drawn)
        if paths is None:
            return None
        row_of = dict(zip(reported.track_id.tolist(), reported.weight.tolist(), strict=True))
        existence = np.array([row_of[track] for track in paths.track_id.tolist()])
        moves = own is not None and bool(np.isfinite(own.velocity).all())
        names = Named(own if moves else None, manual.own, manual.friends)
        found = predict(stamp_ns, paths, existence, names, model)
        self.latest, new = self.alarms.add(found)
        return self.latest, [words(found, row, model.zones) for row in new]
