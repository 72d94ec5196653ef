"""Read a recording in Python: the results of the analysis, and the plain messages as any ROS 2 tool reads them.

Run it with `python examples/read_recording.py BAG`, a bag folder or an .mcap file. Without one it first records five
periods of a scene in lock-step, which needs ROS 2 (the extra `ros`).

Look for: the recording is complete, and the simulation of its commands is identical to the bit. Each cycle except the
first gains 0.14 m, and every slip is forward. The plain `pose` messages contain the same gain, and the scene itself is
an attachment.
"""

import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from crawler_ros.replay.analysis import analyse


def record(folder):
    """Record a simulator while a gait player plays its scene; return the bag folder."""
    scene = ("--ros-args", "-p", "scene:=three_contacts_one_way", "-p")
    node = (sys.executable, "-m")
    simulator = [*node, "crawler_ros.node.simulator", *scene, "lock_step:=true", "-p", f"record:={folder}"]
    running = subprocess.Popen(simulator)
    try:
        subprocess.run([*node, "crawler_ros.node.gait_player", *scene, "periods:=5"], check=True)
    finally:
        running.send_signal(signal.SIGINT)
        running.wait()
    return max(folder.iterdir())


bag = Path(sys.argv[1]) if len(sys.argv) > 1 else record(Path("bags"))

# The analysis: health, cycles, slips, energy.
replay = analyse(bag)
cycles = np.array([(cycle.start, cycle.end, cycle.translation) for cycle in replay.cycles])
slips, energy = replay.slips, replay.energy
slid = [slips.distance[slips.contact == contact].sum() for contact in range(len(replay.contacts))]
print(f"{replay.scene.name}: healthy {replay.healthy}; {replay.explanation}")
print(f"gained in each cycle [m]: {cycles[:, 2].round(9)}")
print(f"slid by each contact [m]: {np.round(slid, 9)}; backward {np.count_nonzero(slips.direction < 0)} times")
print(f"work {energy.work:.6f} J, friction took {energy.dissipation:.6f} J, residual {energy.residual:.0e}")

# The messages, read by rosbags, which is independent of this project.
with AnyReader([bag]) as reader:
    poses = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages() if c.topic.endswith("/pose")]
time = np.array([pose.header.stamp.sec + 1e-9 * pose.header.stamp.nanosec for pose in poses])
position = np.array([pose.pose.position.x for pose in poses])
gained = np.interp(cycles[:, 1], time, position) - np.interp(cycles[:, 0], time, position)
print(f"the same from {len(poses)} bare poses: {gained.round(9)}")

# The file itself, read by mcap: its attachments.
file = bag if bag.suffix == ".mcap" else next(bag.glob("*.mcap"))
with file.open("rb") as stream:
    attached = {found.name: json.loads(found.data) for found in make_reader(stream).iter_attachments()}
print(f"attached: {', '.join(attached)}; its body: {attached['scene']['body']}")
