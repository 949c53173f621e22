# SPDX-License-Identifier: Apache-2.0
"""What tests have done in other processes, which must be able to import it."""

from __future__ import annotations

import os
import signal
import struct
import sys
import time


def whose(_: int) -> int:
    """The number of the process."""
    return os.getpid()


def dies(mine: int) -> int:
    """End any process but the one of this number."""
    if os.getpid() != mine:
        os._exit(1)
    return mine


def sleeps(mine: int) -> None:
    """Take an hour in any process but the one of this number."""
    if os.getpid() != mine:
        time.sleep(3600)


def dies_amid_a_message(mine: int) -> int:
    """As `dies`, by SIGKILL, as if it were just sending a result."""
    if os.getpid() != mine:
        worker = sys._getframe(1)
        os.write(
            worker.f_locals["result_queue"]._writer.fileno(), struct.pack("!i", 1000) + b"the first bytes"
        )
        os.kill(os.getpid(), signal.SIGKILL)
    return mine
