# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""From reports to scans: turning antennas, moving radars, stamps, and reports that come late."""
