"""The displayed sets of a run and their titles."""

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
    """The sets of a run: all classes together, and each class."""

    class_names: tuple[str, ...]  # Configured names

    @staticmethod
    def of(classes: int, class_names: Sequence[str] = ()) -> Sets:
        """Return the sets of `classes` classes; another number of names is ignored."""
        fitting = len(class_names) == classes
        return Sets(tuple(class_names) if fitting else tuple(map(class_set, range(classes))))

    @staticmethod
    def of_summary(summary: Mapping[str, Any]) -> Sets:
        """Return the sets of a run's figures, in the form of `metrics.json`."""
        keys = {key for source in SOURCES for key in summary.get(source) or {}} - {ALL}
        return Sets.of(len(keys), summary.get("class_names") or ())

    @property
    def one_class(self) -> bool:
        """Whether there is only one class, whose set equals the set of all targets."""
        return len(self.class_names) == 1

    @property
    def of_classes(self) -> list[str]:
        """The keys of the shown classes' sets: none if there is only one class."""
        return [] if self.one_class else [class_set(k) for k in range(len(self.class_names))]

    @property
    def keys(self) -> list[str]:
        """The keys of the shown sets."""
        return [ALL, *self.of_classes]

    def class_title(self, class_id: int) -> str:
        """Return the title of a class, configured or not."""
        known = class_id < len(self.class_names)
        name = self.class_names[class_id] if known else class_set(class_id)
        found = _GENERIC.fullmatch(name)
        return name if found is None else f"class {found[1]}"

    def title(self, key: str, everything: str = "all classes") -> str:
        """Return the title of a set; the set of all targets takes the title of an only class."""
        if key != ALL:
            return self.class_title(class_of(key))
        return self.class_title(0) if self.one_class else everything


def class_of(key: str) -> int:
    """Return the class id of a class's set."""
    return int(key.removeprefix("class_"))
