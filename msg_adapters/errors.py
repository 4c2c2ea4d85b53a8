# SPDX-FileCopyrightText: 2026 Seed a9b9ba5d maintainers
# SPDX-License-Identifier: Apache-2.0

"""The error that says why a message was refused."""

from __future__ import annotations


class RejectedMessageError(ValueError):
    """A message that does not fit the contract; it is refused as a whole.

    Parameters
    ----------
    reason : str
        Key that diagnostics count by: ``schema``, ``frame`` or ``oversize``.
    detail : str
        What is wrong, where, and what is allowed.
    """

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(detail)
        self.reason = reason
