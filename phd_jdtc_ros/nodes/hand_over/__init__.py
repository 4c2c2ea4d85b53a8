# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live hand-over: the estimates of trackers that part an area, as one picture."""
