"""Recordings read by other libraries: `python -m benchmarks.node.readers mcap|rosbags BAG` counts messages."""

from __future__ import annotations

import sys
from pathlib import Path


def read_with_mcap(bag: Path) -> int:
    """Read all messages with the mcap library, without decoding them.

    Returns:
        The number of messages.
    """
    from mcap.reader import make_reader

    with next(bag.glob("*.mcap")).open("rb") as stream:
        return sum(1 for _ in make_reader(stream).iter_messages(log_time_order=False))


def read_with_rosbags(bag: Path) -> int:
    """Deserialise all messages with rosbags.

    Returns:
        The number of messages.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    count = 0
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)
            count += 1
    return count


if __name__ == "__main__":
    print({"mcap": read_with_mcap, "rosbags": read_with_rosbags}[sys.argv[1]](Path(sys.argv[2])))
