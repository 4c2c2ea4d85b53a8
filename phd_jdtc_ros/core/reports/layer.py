"""The interface of the layer, for those that hold it without compiling its functions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from ..arrays import BoolArray, FloatArray, IntArray
from ..snapshot import Snapshot
from ..types import Estimates, SelfReports

if TYPE_CHECKING:
    from .looks import Look, Rows


class Layer(Protocol):
    """The layer of self-reports; see `beside.SelfReporting`."""

    @property
    def labels(self) -> IntArray:
        """The labels whose numbers are in use beside those of the engine's targets."""

    def with_reports(self, reports: SelfReports, stamp_ns: int) -> Layer:
        """Return the layer after reports up to a stamp, in any order."""

    def places(self, stamp_ns: int) -> FloatArray:
        """Return where the reports of each source expect it at a stamp, metres, (S, 2)."""

    def after(self, rows: Rows, look: Look, seen: BoolArray) -> Layer:
        """Return the layer after a radar's look."""

    def noted(self, rows: Rows, living: IntArray, stamp_ns: int) -> Layer:
        """Return the layer after a scan."""

    def describe(self, estimates: Estimates, smoothed: bool) -> Estimates:
        """Return estimates with what reports say of them."""

    def of_labels(self, oldest_ns: int) -> Layer:
        """Return the layer without links that end before a stamp."""

    def figures(self) -> dict[str, float]:
        """Return what was learned of the receivers, by dotted name."""

    def to_snapshot(self, snapshot: Snapshot) -> None:
        """Store the layer."""

    def restored(self, snapshot: Snapshot) -> Layer:
        """Return the stored layer; this one if the snapshot has none."""

    def changed(self, **values: Any) -> Layer:
        """Return the layer with some fields changed."""
