# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Chosen limits of metrics: when a gap is long, and how far back OSPA(2) looks."""

from __future__ import annotations

# Gaps longer than this are long. The value is that of ED-142 for en route, as in the evaluation
# tool COMPASS: two updates of 8 s with a margin.
LONG_GAP_S = 16.4
# Scans of an OSPA(2) window: one minute of a radar with a turn of 6 s.
OSPA2_WINDOW = 10
