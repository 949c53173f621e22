# SPDX-License-Identifier: Apache-2.0
"""Logs to look at."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from log_samples import JOINT_STATE, JOINTS, SENSOR_QOS, fill

from cable_ros.log.writer import LogWriter


@pytest.fixture
def write_log(tmp_path: Path) -> Callable[..., Path]:
    """A finished log of `count` joint states and wrenches: `write_log(count, **LogWriter's arguments)`."""

    def write(count: int, **arguments: Any) -> Path:
        path = tmp_path / "run.mcap"
        log = LogWriter(path, **arguments)
        log.add_topic(JOINTS, JOINT_STATE, SENSOR_QOS)
        fill(log, count)
        log.close()
        assert log.error is None
        assert log.written == 2 * count
        return path

    return write
