"""Recordings of robots: rosbag2 (SQLite or MCAP) and bags of ROS 1, through rosbags.

Every number in a message becomes a column: ``/pressure.fluid_pressure``, ``/joint_states.position(1)``. Its times are those
of the message's header where it has one, else those of its arrival, both in s after the first message of the file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rfea_vision.readers.kinds.base import Kind, Points, Table, points_of_columns, refuse_too_much

_UNITS = {"fluid_pressure": "Pa", "point": "m", "position": "m", "translation": "m"}
"""By the definitions of sensor_msgs/FluidPressure (Pa) and REP 103 (lengths in m)."""
_LONGEST = 64
"""Arrays beyond this are pictures or point clouds, not columns."""


def read_bag(path: Path) -> Table:
    """Read one file of a bag."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    columns: dict[str, list[float]] = {}
    times: dict[str, list[float]] = {}
    joints: set[str] = set()
    count = 0
    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
        for connection, arrived_ns, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            stamp = getattr(getattr(message, "header", None), "stamp", None)
            seconds = arrived_ns if stamp is None else stamp.sec * 1_000_000_000 + stamp.nanosec
            if connection.msgtype == "sensor_msgs/msg/JointState":  # of a joint that turns
                joints.add(f"{connection.topic}.position(")
            for name, value in _numbers(connection.topic, message):
                count += 1
                columns.setdefault(name, []).append(value)
                times.setdefault(name, []).append(seconds)
            refuse_too_much(path, count)
    first = min((item[0] for item in times.values()), default=0)
    arrays = {name: np.array(values) for name, values in columns.items()}
    seconds_of = {name: (np.array(values) - first) * 1e-9 for name, values in times.items()}
    units = {name: unit for name in arrays for part, unit in _UNITS.items() if part in name.split(".")[1:]}
    units |= {name: "rad" for name in arrays if name.startswith(tuple(joints))}
    return Table(str(path), arrays, units, seconds_of, _points(str(path), arrays, units, seconds_of), first * 1e-9)


def _numbers(name: str, value: object) -> list[tuple[str, float]]:
    if isinstance(value, bool | int | float | np.number):
        return [(name, float(value))]
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "fiu" or not 0 < value.size <= _LONGEST:
            return []
        return [(f"{name}({index})", float(item)) for index, item in enumerate(value.ravel(), start=1)]
    fields = getattr(value, "__dataclass_fields__", {})
    return [
        pair
        for key in fields
        if key not in ("header", "__msgtype__")
        for pair in _numbers(f"{name}.{key}", getattr(value, key))
    ]


def _points(
    source: str, columns: dict[str, np.ndarray], units: dict[str, str], times: dict[str, np.ndarray]
) -> dict[str, Points]:
    """Points of one topic each: topics keep their own times."""
    found = {}
    for topic in dict.fromkeys(name.split(".")[0] for name in columns):
        mine = {name: values for name, values in columns.items() if name.split(".")[0] == topic}
        points = points_of_columns(source, mine, units, times[next(iter(mine))])
        if points is not None:
            found[topic] = points
    return {"": next(iter(found.values()))} if len(found) == 1 else found


KINDS = (Kind("ROS bag", (".mcap", ".db3", ".bag"), read_bag, extra="ros"),)
