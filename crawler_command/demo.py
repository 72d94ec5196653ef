"""The demonstration: a simulator and a gait player as two processes, and the evaluation of their recording.

The simulator is in lock-step: ten simulated seconds take as long as this machine needs, and the walk is identical to
the bit however busy the machine is.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import time
from pathlib import Path

import numpy as np

from crawler_model import CrawlerError, Scene, load_scene, prepare
from crawler_model.body.drive import NS
from crawler_ros.node.life.domains import domain_environment, reserved_domain
from crawler_ros.recording import bag

from .processes import Process, node_command
from .screen import ShowProgress

SCENE = "three_contacts_one_way"
PERIODS = 10
PATIENCE_S = 600.0  # a busy machine compiles for minutes


class DemoError(CrawlerError):
    """The demonstration did not finish."""


def closed_form(scene: Scene) -> float:
    """Compute the net translation per period of the stepped wave on three one-way contacts.

        2 (D - 3 mu_plus / k)   for D >= 6 mu_plus / k and mu_minus > 2 mu_plus

    Args:
        scene: three equal contacts whose links lengthen in turn by D.

    Returns:
        Net translation per period, after the first [m].
    """
    stroke = float(np.ptp(scene.drive.actuation))
    return 2.0 * (stroke - 3.0 * float(scene.drive.forward[0, 0]) / float(scene.body.stiffness[0]))


def run_demo(out: Path, progress: ShowProgress) -> list[str]:
    """Run the demonstration.

    Args:
        out: folder for the files.
        progress: called with the fraction done, in [0, 1], and the name of the present step.

    Returns:
        The lines of the summary.

    Raises:
        DemoError: when a process fails or does not finish.
    """
    from crawler_pictures.run.run_page import draw_run
    from crawler_ros.viewer.arrays import run_of_frames
    from crawler_ros.viewer.frames import frames_of_recording, thin
    from crawler_ros.viewer.visualizer import draw_recording

    began = time.monotonic()
    progress(0.0, "compiling, once on this machine")
    prepare(load_scene(SCENE))  # compile before the processes wait for each other
    out.mkdir(parents=True, exist_ok=True)
    before = set(out.iterdir())
    progress(0.05, "starting two processes")
    with reserved_domain() as domain:
        given = domain_environment(domain)
        simulator = Process(
            node_command("crawler_ros.node.simulator", scene=SCENE, record=str(out), lock_step=True), given
        )
        player = Process(
            node_command("crawler_ros.node.gait_player", scene=SCENE, periods=PERIODS, patience=PATIENCE_S), given
        )
        try:
            _watch(simulator, player, progress)
        finally:
            player.end()
            simulator.end()
    if simulator.process.returncode != 0:
        raise DemoError(f"the simulator failed: {simulator.last_line()}")
    made = [path for path in set(out.iterdir()) - before if path.is_dir()]
    if len(made) != 1:
        raise DemoError(
            f"{out}: {len(made)} new recordings instead of one; last line of the simulator: {simulator.last_line()}"
        )
    recording = made[0]
    rrd, png = out / f"{recording.name}.rrd", out / f"{recording.name}.png"
    progress(0.7, "writing the run for rerun")
    draw_recording(recording, rrd)
    progress(0.85, "drawing the page")
    scene, frames = frames_of_recording(recording)
    draw_run(run_of_frames(scene, list(thin(frames))), png)
    return _summary(recording, rrd, png, time.monotonic() - began)


def _watch(simulator: Process, player: Process, progress: ShowProgress) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while player.process.poll() is None:
        if simulator.process.poll() is not None:
            raise DemoError(f"the simulator ended early: {simulator.last_line()}")
        if time.monotonic() > deadline:
            raise DemoError(
                f"not finished within {PATIENCE_S:g} s; last line of the simulator: {simulator.last_line()}"
            )
        for process in (simulator, player):
            for line in process.new_lines():
                done = re.search(r"period (\d+) of (\d+)", line)
                if done:
                    progress(0.1 + 0.6 * int(done[1]) / int(done[2]), f"walking: period {done[1]} of {done[2]}")
                elif "compiling" in line:
                    print(line, file=sys.stderr)
        time.sleep(0.05)
    if player.process.returncode != 0:
        raise DemoError(f"the gait player failed: {player.last_line()}")


def _summary(recording: Path, rrd: Path, png: Path, seconds: float) -> list[str]:
    gains, messages, factor = measure(recording)
    steady = gains[1:]
    exact = closed_form(load_scene(SCENE))
    error = float(np.abs(steady - exact).max())
    if gains.size != PERIODS or error > 1e-9:
        raise DemoError(f"{recording}: per period {gains.tolist()} m instead of {PERIODS} times {exact:.12g} m")
    mcap = bag.find_file(recording)
    beside = Path(sys.executable).parent / "crawler"
    command = "crawler" if shutil.which("crawler") or not beside.is_file() else os.path.relpath(beside)
    return [
        f"A three-contact crawler walked {PERIODS} periods under commands from another process ({seconds:.0f} s).",
        f"  distance per period  {steady.mean():.12f} m (closed form {exact:.12f} m, largest error {error:.1e} m)",
        f"  first period         {gains[0]:.12f} m (with the transient from rest)",
        f"  real-time factor     {factor:.1f}, lag 0 s (in lock-step the clock sets no pace)",
        "Files:",
        f"  {mcap}  ({messages} messages; opens in rosbag2, Foxglove, PlotJuggler, rerun)",
        f"  {rrd}",
        f"  {png}",
        "Next:",
        f"  {command} replay {recording}    cycles, slips and energy of this run, simulated again",
        f"  {command} scenes    the other scenes",
        f"  {command} simulate two_anchor_a    only the model, without ROS",
        f"  {command} view {rrd}    the run in rerun, where there is a display",
    ]


def measure(recording: Path) -> tuple[np.ndarray, int, float]:
    """Read the net translation in each period, and the pace, from a recording of the demonstration.

    Args:
        recording: a bag folder.

    Returns:
        Net translation gained in each whole period [m], the number of messages, and the simulated seconds per second.
    """
    from rosbags.typesys import Stores, get_typestore

    decode = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr
    period_ns = round((load_scene(SCENE).drive.period or 0.0) * NS)
    start_ns: int | None = None
    y: dict[int, float] = {}
    messages = 0
    received: list[int] = []
    for record in bag.read(recording):
        messages += 1
        message = decode(record.data, record.type)
        if record.topic.endswith("joint_trajectory") and not start_ns:  # a message without a stamp plays nothing
            start_ns = message.header.stamp.sec * NS + message.header.stamp.nanosec
        elif record.topic.endswith("pose"):
            y[message.header.stamp.sec * NS + message.header.stamp.nanosec] = message.pose.position.x
            received.append(record.log_ns)
    if not start_ns:
        raise DemoError(f"{recording}: no command arrived")
    # a late command was still followed, well before the end of its period
    ends = [start_ns + k * period_ns for k in range(PERIODS + 1)]
    pace = (max(y) - min(y)) / max(received[-1] - received[0], 1) if y else 0.0
    return np.diff([y[ns] for ns in ends if ns in y]), messages, pace
