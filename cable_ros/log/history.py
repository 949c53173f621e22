# SPDX-License-Identifier: Apache-2.0
"""A logged run as arrays: what was solved, and what the cables did to their links."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cable_ros.log.errors import LogError
from cable_ros.log.joint_state_cdr import JOINT_STATE
from cable_ros.log.reader import LogReader
from cable_ros.log.run import DIAGNOSTICS, PATH, LoggedRun, Solve


@dataclass(frozen=True)
class History:
    """The m solves of a run, in order."""

    joint_names: tuple[str, ...]
    times: np.ndarray
    """(m,) log times, ns."""
    joints: np.ndarray
    """(m, n) positions, rad or m; NaN before a joint was first heard of."""
    end_wrenches: dict[str, np.ndarray]
    """By cable: (m, 6) force [N] and moment [N m] on the body at the end clamp, in its frame; NaN where the
    cable had no trusted equilibrium."""
    polylines: dict[str, np.ndarray]
    """By cable: (k,) which of the solves have a polyline in the log."""
    joint_load: dict[str, np.ndarray] = field(default_factory=dict)
    """By joint: (m,) torque of all cables on it, N m, or N on a prismatic one; NaN where none is logged."""
    limit_use: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)
    """By cable and quantity that has a limit: (m,) part of it in use; NaN where none is logged."""


def read_history(path: str | Path) -> History:
    """Read all solves of a log.

    Raises:
        LogError: the log cannot be read, or holds no wrench or no joints.
    """
    from tqdm import tqdm

    with LogReader(path) as reader:
        run = LoggedRun([reader])
        items = tqdm(run, total=run.count, desc=f"reading {path}", unit="pose", disable=None, leave=False)
        solves = [item for item in items if isinstance(item, Solve)]
        loads, uses = _loads(reader), _uses(reader)
    names = tuple(dict.fromkeys(name for solve in solves for name in solve.joints))
    cables = dict.fromkeys(cable for solve in solves for cable, _ in solve.wrenches)
    missing = np.full(6, np.nan)
    return History(
        joint_names=names,
        times=np.array([solve.log_time for solve in solves], dtype=np.int64),
        joints=_table([[solve.joints.get(name, np.nan) for name in names] for solve in solves], len(names)),
        end_wrenches={
            cable: _table([solve.wrenches.get((cable, "end"), missing) for solve in solves], 6)
            for cable in cables
        },
        polylines={
            cable: np.array([i for i, solve in enumerate(solves) if cable in solve.polylines], dtype=int)
            for cable in cables
        },
        joint_load={
            joint: np.array([of_stamp.get(solve.stamp, np.nan) for solve in solves])
            for joint, of_stamp in loads.items()
        },
        limit_use={
            cable: {
                quantity: np.array([of_stamp.get(solve.stamp, np.nan) for solve in solves])
                for quantity, of_stamp in quantities.items()
            }
            for cable, quantities in uses.items()
        },
    )


def _loads(reader: LogReader) -> dict[str, dict[int, float]]:
    """By joint and stamp, ns: what the cables exert on it. The stamp is that of the joint state."""
    out: dict[str, dict[int, float]] = {}
    topics = [
        topic.name
        for topic in reader.topics.values()
        if topic.type_name == JOINT_STATE and topic.name.endswith("/joint_load")
    ]
    for _, message in reader.decoded(topics) if topics else ():
        try:
            stamp = int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)
            for joint, load in zip(map(str, message.name), map(float, message.effort), strict=False):
                out.setdefault(joint, {})[stamp] = load
        except (AttributeError, TypeError, ValueError) as error:
            raise LogError(
                f"{reader.path}: a joint load has not the fields of a {JOINT_STATE} ({error})."
            ) from None
    return out


def _uses(reader: LogReader) -> dict[str, dict[str, dict[int, float]]]:
    """By cable, quantity and stamp, ns: what part of its limit is in use."""
    out: dict[str, dict[str, dict[int, float]]] = {}
    topics = [
        topic.name
        for topic in reader.topics.values()
        if topic.type_name == DIAGNOSTICS and topic.name.endswith("/limits")
    ]
    for _, message in reader.decoded(topics) if topics else ():
        try:
            stamp = int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)
            for status in message.status:
                cable, _, quantity = str(status.name).partition(": ")
                values = {str(value.key): str(value.value) for value in status.values}
                if not any(key.startswith("limit") and value == "none" for key, value in values.items()):
                    out.setdefault(cable, {}).setdefault(quantity, {})[stamp] = float(values["use"])
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise LogError(
                f"{reader.path}: a message of limits has not the entries of one ({error})."
            ) from None
    return out


def read_polyline(path: str | Path, cable: str, time: int) -> np.ndarray:
    """(n, 3) points of the cable's polyline with this log time, ns; world frame, m.

    Raises:
        LogError: the log cannot be read, or has no such polyline.
    """
    with LogReader(path) as reader:
        topics = [
            topic.name
            for topic in reader.topics.values()
            if topic.type_name == PATH and topic.name.endswith(f"/{cable}/polyline")
        ]
        # A recorder other than the node stamps each message with its own time of arrival.
        for _, message in reader.decoded(topics, time):
            return _points(path, message)
    raise LogError(f"{path} holds no polyline of {cable} at or after {time} ns.")


def _points(path: str | Path, message: Any) -> np.ndarray:
    try:
        positions = (pose.pose.position for pose in message.poses)
        return np.array([[point.x, point.y, point.z] for point in positions], dtype=float).reshape(-1, 3)
    except (AttributeError, TypeError, ValueError) as error:
        raise LogError(f"{path}: a polyline has not the fields of a {PATH} ({error}).") from None


def _table(rows: list[Any], columns: int) -> np.ndarray:
    return np.array(rows, dtype=float).reshape(len(rows), columns)
