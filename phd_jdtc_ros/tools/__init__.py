# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The executables that are no nodes: simulate, track a bag, report, a study, and the demo."""
