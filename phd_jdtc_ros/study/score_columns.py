# Copyright 2026 Seed a9b9ba5d maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
