# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Labels of origins: every scan has a block of numbers for the targets that it founds."""

from __future__ import annotations

ORIGINS_PER_SCAN = 1 << 24


def first_predicted(scan_index: int) -> int:
    """Return the first label of the targets that a scan's prediction founds."""
    return scan_index * ORIGINS_PER_SCAN


def first_detected(scan_index: int) -> int:
    """Return the first label of the targets that a scan's detections found."""
    return scan_index * ORIGINS_PER_SCAN + ORIGINS_PER_SCAN // 2
