# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""Why a message or a bag was refused."""

from __future__ import annotations


class RejectedMessageError(ValueError):
    """A message that does not fit the contract; the whole of it is refused.

    Parameters
    ----------
    reason : str
        Short and countable: ``schema``, ``frame`` or ``oversize``.
    detail : str
        What was wrong, where, and what is allowed.
    """

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(detail)
        self.reason = reason
