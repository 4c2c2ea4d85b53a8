# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What metrics go by that is a choice: when a gap is long, and how long OSPA(2) looks back."""

from __future__ import annotations

# A gap that lasts longer is long: ED-142 en route, as the evaluation tool COMPASS codes it. It is
# two updates of 8 s and a little.
LONG_GAP_S = 16.4
# Scans of an OSPA(2) window: a minute of a radar that turns in 6 s.
OSPA2_WINDOW = 10
