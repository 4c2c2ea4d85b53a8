# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Random traffic for scenarios: flights, ships and cars by their kinds."""
