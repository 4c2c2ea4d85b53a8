# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Scenarios with known truth, and simulated scans of them.

::

    document (YAML, read elsewhere)
      |  check                               scenario_file
    Scenario: targets, turns, radars         scenario
      |  detect, with clutter                simulate
    (Truth, Scan) by stamp
"""
