# SPDX-License-Identifier: Apache-2.0
"""A writer that is killed loses at most the chunk that was open."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from log_samples import WRENCH

from cable_ros.log.errors import LogError
from cable_ros.log.reader import LogReader
from cable_ros.log.recover import recover

WRITE_FOREVER = """
import sys, time
from log_samples import fill
from cable_ros.log.writer import LogWriter
log = LogWriter(sys.argv[1], attachments={"scene.yaml": "a scene"})
start = time.monotonic()
count = 0
while True:
    fill(log, 10, count)
    count += 10
    print(count, time.monotonic() - start, flush=True)
    time.sleep(0.005)
"""


@pytest.mark.parametrize("run_for", [1.3, 2.05])
def test_what_is_a_second_old_survives_sigkill(tmp_path, run_for):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(["test", *sys.path])}
    path = tmp_path / "run.mcap"
    with subprocess.Popen(
        [sys.executable, "-c", WRITE_FOREVER, str(path)],
        env=environment,
        cwd=Path(__file__).parents[2],
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        reports = []
        for line in process.stdout:
            count, seconds = line.split()
            reports.append((int(count), float(seconds)))
            if reports[-1][1] >= run_for:
                break
        process.send_signal(signal.SIGKILL)
    old_enough = max(count for count, seconds in reports if seconds <= reports[-1][1] - 1.0)

    part = path.with_name("run.mcap.part")
    with pytest.raises(LogError, match=r"without an index.*cable log recover .*run\.mcap\.part"):
        LogReader(part)
    saved = recover(part)
    assert saved.path == path
    assert saved.messages[WRENCH] >= old_enough
    with LogReader(path) as log:
        assert log.scene_text == "a scene"
        assert [m.sequence for m in log.messages([WRENCH])] == list(range(saved.messages[WRENCH]))
