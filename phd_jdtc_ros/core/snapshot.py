# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What an engine holds, as plain arrays and numbers: to be stored, and to go on from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy.typing as npt


@dataclass(frozen=True)
class Snapshot:
    """An engine's state: data, never code.

    Parameters
    ----------
    stamp_ns : int or None
        Of the last scan that was taken in; None before the first.
    arrays : dict of name to array
        By dotted name.
    facts : dict
        What JSON can hold: numbers, strings, lists and dicts.
    """

    stamp_ns: int | None
    arrays: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    facts: dict[str, Any] = field(default_factory=dict)

    def array(self, name: str) -> npt.NDArray[Any]:
        """Return a stored array.

        Raises
        ------
        ValueError
            If there is none of this name.
        """
        if name not in self.arrays:
            raise ValueError(f"{name}: missing")
        return self.arrays[name]
