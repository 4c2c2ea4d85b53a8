# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What recordings say of the radars: their errors (registration) and parameters (tuning)."""
