# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""From parameters to a tracker.

::

    dotted names and values
      |  type and bounds of each             schema (a parameter), parameters (the table)
      |  what they must be together          checks
      |  units, matrices, models             build
    TrackerConfig
"""
