# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""In place of the package of this name, whose messages are not on PyPI; see `bondpy`."""
