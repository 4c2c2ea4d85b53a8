# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The executables that are not nodes: simulate, track_bag, report, monte_carlo and the demo."""
