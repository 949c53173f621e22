# SPDX-License-Identifier: Apache-2.0
"""How often to try again what has failed."""

from __future__ import annotations


class Backoff:
    """Turns to let pass before the next try: 0, 1, 3, 7, ... after each try that did not last.

    Args:
        most: the largest number of turns.
    """

    def __init__(self, most: int) -> None:
        self.most = most
        self.reset()

    def reset(self) -> None:
        """Try at every turn again."""
        self._left = self._next = 0

    @property
    def waits(self) -> bool:
        """Whether this turn is one to let pass."""
        return self._left > 0

    def skip(self) -> None:
        """One turn less to let pass, if there is any."""
        self._left = max(self._left - 1, 0)

    def skip_next(self) -> None:
        """Let the next turn pass at least."""
        self._left = max(self._left, 1)

    def tried(self) -> None:
        """Let turns pass now, and about twice as many the next time."""
        self._left, self._next = self._next, min(2 * self._next + 1, self.most)

    def shorten(self) -> None:
        """One turn less the next time."""
        if self._next:
            self._next -= 1
