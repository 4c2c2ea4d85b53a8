# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a radar measures of a state, where it sees, how it errs, and where it stands."""
