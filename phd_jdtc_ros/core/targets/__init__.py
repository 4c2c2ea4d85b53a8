# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What targets do: motions and their modes, births, spawning, and how strong their echoes are."""
