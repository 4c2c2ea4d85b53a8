# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The figures of a run as columns: heading, key in a set's figures, how values are written.

One list for the terminal and the report's page.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

Columns: TypeAlias = "Sequence[tuple[str, str, str]]"

OSPA = (
    ("OSPA", "ospa", "{:.1f} m"),
    ("localisation", "localization", "{:.1f} m"),
    ("cardinality", "cardinality", "{:.1f} m"),
    ("number error", "cardinality_abs_error", "{:.3f}"),
)
GOSPA = (
    ("GOSPA", "gospa", "{:.1f} m"),
    ("localisation", "gospa_localization", "{:.1f} m"),
    ("missed", "missed", "{:.3f}"),
    ("false", "false", "{:.3f}"),
)
SURVEILLANCE = (
    ("position RMS", "position_rms", "{:.1f} m"),
    ("position detected", "position_detection", "{:.2%}"),
    ("longest gap", "longest_gap_s", "{:.1f} s"),
    ("long gaps", "long_gap_share", "{:.1%}"),
    ("missed in them", "long_gap_misses", "{:.2%}"),
)
OSPA2 = ("OSPA(2)", "ospa2", "{:.1f} m")
