# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Why a recording tells nothing of its radars' systematic errors."""

from __future__ import annotations


class RegistrationError(ValueError):
    """A recording that says too little; the text says what is missing."""
