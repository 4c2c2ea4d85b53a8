"""The compared sets of a run as readers see them: which are shown, and by what names."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from phd_jdtc_ros.core.types import SOURCES
from phd_jdtc_ros.evaluation.comparison import ALL, class_set

_GENERIC = re.compile(r"class_(\d+)")


@dataclass(frozen=True)
class Sets:
    """The sets of a run: all classes together, and each class.

    Parameters
    ----------
    class_names : tuple of str
        As configured.
    """

    class_names: tuple[str, ...]

    @staticmethod
    def of(classes: int, class_names: Sequence[str] = ()) -> Sets:
        """Return the sets of a number of classes; names for another number are not used."""
        fitting = len(class_names) == classes
        return Sets(tuple(class_names) if fitting else tuple(map(class_set, range(classes))))

    @staticmethod
    def of_summary(summary: Mapping[str, Any]) -> Sets:
        """Return the sets of a run's figures, in the form of `metrics.json`."""
        keys = {key for source in SOURCES for key in summary.get(source) or {}} - {ALL}
        return Sets.of(len(keys), summary.get("class_names") or ())

    @property
    def one_class(self) -> bool:
        """Whether there is only one class, so that its set is the same as that of all."""
        return len(self.class_names) == 1

    @property
    def of_classes(self) -> list[str]:
        """The keys of the classes' sets that are shown: none if there is only one class."""
        return [] if self.one_class else [class_set(k) for k in range(len(self.class_names))]

    @property
    def keys(self) -> list[str]:
        """The keys of the sets that are shown."""
        return [ALL, *self.of_classes]

    def class_title(self, class_id: int) -> str:
        """Return the shown name of a class, which may be one that is not configured."""
        known = class_id < len(self.class_names)
        name = self.class_names[class_id] if known else class_set(class_id)
        found = _GENERIC.fullmatch(name)
        return name if found is None else f"class {found[1]}"

    def title(self, key: str, everything: str = "all classes") -> str:
        """Return the shown name of a set; that of all is the only class's if there is one."""
        if key != ALL:
            return self.class_title(class_of(key))
        return self.class_title(0) if self.one_class else everything


def class_of(key: str) -> int:
    """Return the class of a class's set."""
    return int(key.removeprefix("class_"))
