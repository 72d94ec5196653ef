"""Peers that die, viewers that stop, disks that fill up, clocks that jump: the crawler goes on, and says so."""

from __future__ import annotations

import mmap
import os
import random
import re
import resource
import shutil
import signal
import struct
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
from mcap.reader import make_reader
from std_msgs.msg import Float64MultiArray

from crawler_model import Crawler, load_scene
from crawler_ros.recording import bag
from crawler_ros.replay import simulate_again

from ...commands import crawler
from ...processes import PATIENCE_S, children, memory_mb, wait_until
from .graph import environment, graph, only
from .machine import (
    DECODE,
    SOAK,
    assert_every_tick,
    assert_whole,
    recorded,
    simulator,
    stamp_ns,
    status,
    stop,
    value,
)

SECOND = 10**9


def wait_for_more(ros, count=50, topic="joint_states"):
    heard = len(ros.heard[topic])
    wait_until(lambda: len(ros.heard[topic]) > heard + count, what=f"more of {topic}")


# -- peers that die ---------------------------------------------------------------------------------------------------


def test_a_controller_that_is_killed_and_comes_back(ros):
    """It held what the dead one had asked for; the next one takes it from there."""
    scene, bags = "scene:=three_contacts_two_ways", ros.folder / "bags"
    process = ros.simulator(scene, f"record:={bags}", hear=("joint_states", "applied_commands"))
    for _ in range(5 if SOAK else 1):
        player = ros.start("crawler_ros.node.gait_player", scene)
        wait_until(lambda: ros.heard["applied_commands"] and ros.heard["applied_commands"][-1].points, what="a walk")
        wait_for_more(ros, 130)  # in mid-period
        player.end(signal.SIGKILL)
        wait_until(
            lambda: not any(m.points for m in ros.heard["applied_commands"][-30:]), what="the end of what was sent"
        )
        held = ros.heard["joint_states"][-1]
        wait_for_more(ros)
        assert ros.heard["joint_states"][-1].position == held.position
        assert stamp_ns(ros.heard["joint_states"][-1]) > stamp_ns(held)
    held = len(ros.heard["applied_commands"])
    player = ros.start("crawler_ros.node.gait_player", scene, "periods:=3")
    assert player.wait() == 0
    ros.taken_up()
    wait_for_more(ros, 2)  # however late its last message came, it is followed
    assert process.end() == 0
    path = only(bags)
    assert_whole(path)
    drive = load_scene("three_contacts_two_ways").drive
    crawler = Crawler(load_scene("three_contacts_two_ways"))
    for message in recorded(path, "/applied_commands"):
        if stamp_ns(message) > stamp_ns(ros.heard["applied_commands"][held - 1]):
            break
        if message.points:
            crawler.follow(np.array([p.positions for p in message.points]))
    y = []
    for _ in range(3):
        crawler.follow(np.ascontiguousarray(drive.targets))
        y.append(crawler.net_translation)
    assert recorded(path, "/pose")[-1].pose.position.x == pytest.approx(y[2], abs=1e-12)
    assert y[2] - y[1] == pytest.approx(0.07, abs=1e-12)


def drive_on(ros, topics, stopping):
    """Send a wave to each of some actuation topics, 50 times a second."""
    k = 0
    while not stopping.is_set():
        k += 1
        for topic, phase in topics.items():
            data = (0.2 * np.sin([0.05 * k + phase, 0.031 * k])).tolist()
            ros.publish(topic, Float64MultiArray(data=data), "actuation_controller/commands")
        time.sleep(0.02)  # a pace: nobody waits for it


@contextmanager
def driven(ros, *prefixes):
    """Keep crawlers moving."""
    topics = {f"{prefix}actuation_controller/commands": float(i) for i, prefix in enumerate(prefixes or [""])}
    stopping = threading.Event()
    thread = threading.Thread(target=drive_on, args=(ros, topics, stopping))
    thread.start()
    try:
        yield
    finally:
        stopping.set()
        thread.join()


def written(path: Path, name: str) -> int:
    """How many states a recording that is being written would leave if all died now."""
    return bag.examine(path).counts.get(f"/{name}/joint_states", 0) if list(path.glob("*.mcap")) else 0


@pytest.mark.slow
@pytest.mark.parametrize("turn", range(20 if SOAK else 2))
def test_killed_at_random_moments_it_leaves_what_can_be_recovered(tmp_path, turn):
    """Ten simulators at once: ended, killed, or killed together with their recording processes."""
    rng = random.Random(turn)
    ways = [("INT",), ("TERM",), *[("KILL",)] * 3, *[("KILL", "KILL")] * 5]
    names = [f"c{k}" for k in range(len(ways))]
    with graph(tmp_path) as ros:
        processes = {}
        for name in names:
            ros.hear(f"/{name}/joint_states", type_name="joint_states")
            given = (f"record:={tmp_path / name}", "rate:=200.0")
            processes[name] = ros.start(
                "crawler_ros.node.simulator", *given, arguments=("-r", f"__ns:=/{name}")
            ).process
        wait_until(lambda: all(ros.heard[f"/{n}/joint_states"] for n in names), what="ten crawlers")
        recorders = {name: children(process.pid) for name, process in processes.items()}
        least = {}
        with driven(ros, *[f"/{name}/" for name in names]):
            for name in names:
                wait_for_more(ros, 400, f"/{name}/joint_states")
                wait_until(lambda n=name: written(only(tmp_path / n), n) > 100, what=f"states of {name} on disk")
            for name, way in zip(names, ways, strict=True):
                time.sleep(rng.uniform(0.0, 0.4))  # any moment will do
                if len(way) > 1:  # with its recording process, what was on disk is kept
                    least[name] = written(only(tmp_path / name), name)
                else:  # without, all but what was not yet handed to it
                    least[name] = round(200 * stamp_ns(ros.heard[f"/{name}/joint_states"][-1]) / SECOND) - 10
                processes[name].send_signal(getattr(signal, f"SIG{way[0]}"))
                for pid in recorders[name] if len(way) > 1 else []:
                    os.kill(pid, signal.SIGKILL)
        for name, way in zip(names, ways, strict=True):
            processes[name].wait(PATIENCE_S)
            path = only(tmp_path / name)
            if len(way) == 1:
                wait_until(lambda p=path: (p / "metadata.yaml").exists(), what=f"the end of {path}")
                wait_until(lambda p=path: bag.examine(p).complete, what=f"a whole {path}")
            else:
                assert not bag.examine(path).complete
                bag.recover(path, tmp_path / f"{name}_recovered")
                path = tmp_path / f"{name}_recovered"
                assert bag.examine(path).complete
            kept = assert_every_tick(path, f"/{name}/joint_states", 200)
            assert kept // (SECOND // 200) + 1 >= least[name], way
            moved = recorded(path, f"/{name}/joint_states")[-1]
            assert np.any(moved.position)


# -- viewers and listeners that stop ----------------------------------------------------------------------------------


def test_behind_a_stopped_viewer_frames_are_dropped_and_counted(ros):
    process = ros.simulator("view:=live", "real_time_factor:=50.0", hear=("joint_states", "/diagnostics"))
    (viewer,) = children(process.process.pid)
    wait_until(lambda: status(ros, "viewer"), what="word of the viewer")
    before = int(value(ros, "viewer", "dropped"))  # a busy machine draws slowly
    stop(viewer)
    try:
        wait_until(lambda: int(value(ros, "viewer", "dropped")) > before + 100, what="dropped frames")
        assert "the viewer is slow" in status(ros, "viewer").message
        assert status(ros, "viewer").level == b"\x01"
        before = memory_mb(process.process.pid)
        wait_for_more(ros, 5_000)
        assert memory_mb(process.process.pid) - before < 32
    finally:
        os.kill(viewer, signal.SIGCONT)
    wait_for_more(ros)
    assert process.end() == 0


LISTENER = """
import rclpy
from crawler_ros.wire.topics import message_class, qos_profile, read_topics
rclpy.init()
node = rclpy.create_node("slow")
for name, topic in read_topics().items():
    if topic.direction == "out":
        node.create_subscription(message_class(topic.type), name, lambda m: None, qos_profile(topic))
print("listening", flush=True)
heard = 0
def count(m):
    global heard
    heard += 1
    if heard == 100:
        print("heard", flush=True)
node.create_subscription(message_class("sensor_msgs/msg/JointState"), "joint_states", count, 10)
rclpy.spin(node)
"""


def test_a_stopped_listener_stops_nobody(ros):
    """It has asked for every message of every topic, reliably, and reads none of them."""
    bags = ros.folder / "bags"
    process = ros.simulator("rate:=1000.0", f"record:={bags}", hear=("joint_states",))
    listener = ros.run([sys.executable, "-c", LISTENER])
    wait_until(lambda: "heard" in listener.said, what="a listener")
    with driven(ros):
        stop(listener.process.pid)
        try:
            wait_for_more(ros, 500)
            before = memory_mb(process.process.pid)
            wait_for_more(ros, 5_000)
            assert memory_mb(process.process.pid) - before < 32
        finally:
            listener.process.send_signal(signal.SIGCONT)
        wait_for_more(ros)
    listener.end(signal.SIGKILL)
    assert process.end() == 0
    assert_whole(only(bags), rate=1000)


# -- disks that fill up -----------------------------------------------------------------------------------------------


def fails_to_record(ros, bags, reason, fill):
    """Record until it fails; the crawler must go on, say so, and what was written must be of use."""
    process = ros.simulator("rate:=1000.0", f"record:={bags}", hear=("joint_states", "/diagnostics"))
    with driven(ros):
        wait_for_more(ros, 1000)  # of which the file has all but the last half second
        fill(children(process.process.pid))
        wait_until(lambda: getattr(status(ros, "recording"), "level", b"") == b"\x02", what="an error")
        assert reason in status(ros, "recording").message
        wait_until(lambda: reason in process.said, what="a line in the log")
        wait_for_more(ros, 1000)
    assert process.end() == 1
    path = only(bags)
    told = f"recording stopped: {path}: [Errno {28 if 'space' in reason else 27}] {reason}; crawler replay --recover"
    assert process.said.splitlines()[-1].startswith(f"simulator: {told}")
    assert process.said.count(told) >= 2
    assert "Traceback" not in process.said
    return path


def assert_recovered(path):
    """Recover a torn recording by the command, as a user would."""
    torn = bag.examine(path)
    assert not torn.complete
    told = crawler("replay", str(path))
    assert told.returncode == 1
    assert "crawler replay --recover" in told.stderr
    done = crawler("replay", "--recover", str(path))
    assert done.returncode == 0, done.stderr
    whole = path.with_name(path.name + "_recovered")
    assert bag.examine(whole).complete
    assert bag.examine(whole).counts == torn.counts
    assert assert_every_tick(whole, rate=1000) > SECOND // 2


def test_a_recording_that_may_not_grow_is_given_up_and_recovered(ros):
    """What a full disk does, without one: the recording process may write no more than it has."""

    def fill(pids):
        for pid in pids:
            (size,) = (f.stat().st_size for f in (ros.folder / "bags").rglob("*.mcap"))
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (size + 40_000, size + 40_000))

    assert_recovered(fails_to_record(ros, ros.folder / "bags", "File too large", fill))


@contextmanager
def small_disk(folder: Path, options: str):
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)], capture_output=True, text=True
    )
    if mounted.returncode != 0:
        pytest.skip(f"a file system cannot be mounted here: {mounted.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", str(folder)], check=True)


@pytest.mark.slow
def test_on_a_full_disk_the_crawler_goes_on(tmp_path):
    with small_disk(tmp_path / "disk", "size=400k") as disk:
        with graph(tmp_path) as ros:
            path = fails_to_record(ros, disk / "bags", "No space left on device", lambda pids: None)
        full = crawler("replay", "--recover", str(path))
        assert full.returncode == 1
        assert "No space left on device" in full.stderr
        assert "Traceback" not in full.stderr
        shutil.copytree(path, tmp_path / "elsewhere" / path.name)
    assert_recovered(tmp_path / "elsewhere" / path.name)


# -- clocks and ticks -------------------------------------------------------------------------------------------------

JUMPING = """
import mmap, struct, sys, time
file = open(sys.argv.pop(1), "rb")
offset = mmap.mmap(file.fileno(), 8, access=mmap.ACCESS_READ)
real_ns, real = time.time_ns, time.time
time.time_ns = lambda: real_ns() + 10**9 * struct.unpack("<q", offset[:8])[0]
time.time = lambda: real() + struct.unpack("<q", offset[:8])[0]
from crawler_ros.node.simulator import main
sys.exit(main())
"""

PRELOADED = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static const volatile long *offset;
__attribute__((constructor)) static void open_offset(void) {
  int fd = open(getenv("CLOCK_OFFSET_FILE"), O_RDONLY);
  offset = mmap(NULL, sizeof(long), PROT_READ, MAP_SHARED, fd, 0);
  close(fd);
}
static long shift(void) { return offset ? *offset : 0; }
#define REAL(type, name) static type (*real)() = NULL; if (!real) real = dlsym(RTLD_NEXT, #name)

int clock_gettime(clockid_t id, struct timespec *t) {
  REAL(int, clock_gettime);
  int r = real(id, t);
  if (id == CLOCK_REALTIME || id == CLOCK_REALTIME_COARSE) t->tv_sec += shift();
  return r;
}
int gettimeofday(struct timeval *restrict t, void *restrict zone) {
  REAL(int, gettimeofday);
  int r = real(t, zone);
  t->tv_sec += shift();
  return r;
}
time_t time(time_t *t) {
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  if (t) *t = now.tv_sec;
  return now.tv_sec;
}
/* the kernel has not jumped: deadlines on the wall clock, not those on the steady one, go back to its time */
int pthread_cond_timedwait(pthread_cond_t *restrict c, pthread_mutex_t *restrict m, const struct timespec *restrict t) {
  REAL(int, pthread_cond_timedwait);
  struct timespec due = *t;
  if (due.tv_sec > 1000000000) due.tv_sec -= shift();
  return real(c, m, &due);
}
int pthread_mutex_timedlock(pthread_mutex_t *restrict m, const struct timespec *restrict t) {
  REAL(int, pthread_mutex_timedlock);
  struct timespec due = *t;
  due.tv_sec -= shift();
  return real(m, &due);
}
"""


def jumping_simulator(ros, way, offset, *parameters):
    """A simulator whose wall clock is what a file says ahead: only Python's, or the whole process's."""
    command = simulator(*parameters)
    if way == "python":
        script = ros.folder / "jumping.py"
        script.write_text(JUMPING)
        return ros.run([command[0], str(script), str(offset), *command[3:]])
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no C compiler to build a jumping clock with")
    source, library = ros.folder / "jumping.c", ros.folder / "jumping.so"
    source.write_text(PRELOADED)
    built = subprocess.run(
        [compiler, "-std=gnu11", "-w", "-shared", "-fPIC", "-o", library, source, "-ldl"],
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stderr
    return ros.run(command, LD_PRELOAD=str(library), CLOCK_OFFSET_FILE=str(offset))


@pytest.mark.parametrize("way", [pytest.param("python", marks=pytest.mark.slow), "process"])
def test_when_the_hosts_clock_jumps_nothing_does(ros, way):
    """An hour ahead, an hour behind, back again: ticks, stamps and the order of the recording know nothing of it."""
    file, bags = ros.folder / "offset", ros.folder / "bags"
    file.write_bytes(bytes(8))
    with file.open("r+b") as stream, mmap.mmap(stream.fileno(), 8) as offset:
        for name in ("joint_states", "/diagnostics"):
            ros.hear(name)
        process = jumping_simulator(ros, way, file, "rate:=200.0", f"record:={bags}")
        wait_until(lambda: ros.heard["joint_states"] or process.process.poll() is not None, what="the first state")
        assert process.process.poll() is None, process.said
        with driven(ros):
            wait_for_more(ros, 200)
            begin, first = time.monotonic_ns(), stamp_ns(ros.heard["joint_states"][-1])
            for jump in (3600, -3600, 0):
                offset[:8] = struct.pack("<q", jump)
                wait_for_more(ros, 200)
                at = ros.heard["/diagnostics"]
                count = len(at)
                wait_until(lambda c=count, a=at: len(a) > c + 1, what="diagnostics")
                if jump:  # it did jump
                    assert abs(at[-1].header.stamp.sec - time.time() - jump) < 1800.0
        gone = stamp_ns(ros.heard["joint_states"][-1]) - first
        assert gone < time.monotonic_ns() - begin + 1800 * SECOND  # it makes up for no hour
        assert process.end() == 0
    path = only(bags)
    assert_whole(path, rate=200)
    records = list(bag.read(path))
    times = np.array([r.log_ns for r in records])
    assert times.max() - times.min() < 3000 * SECOND  # none of the hours
    for topic in ("/joint_states", "/applied_commands", "/actuation_controller/commands"):
        own = [r.log_ns for r in records if r.topic == topic]
        assert own == sorted(own)
    with bag.find_file(path).open("rb") as stream:  # readers play by log time
        played = [m.sequence for _, c, m in make_reader(stream).iter_messages() if c.topic == "/joint_states"]
    assert played == list(range(len(played)))


def test_late_ticks_are_counted_and_none_is_skipped(ros):
    """Stopped for half a second: a late tick, simulated time that much slower for good, and every stamp there."""
    bags = ros.folder / "bags"
    process = ros.simulator(f"record:={bags}", hear=("joint_states", "/diagnostics"))
    wait_until(lambda: status(ros, "simulation"), what="diagnostics")
    before = int(value(ros, "simulation", "late ticks"))
    for k in range(1, 4):
        stop(process.process.pid)
        time.sleep(0.5)  # what it misses
        process.process.send_signal(signal.SIGCONT)
        wait_for_more(ros, 20)
        wait_until(lambda k=k: int(value(ros, "simulation", "late ticks")) >= before + k, what="a late tick")
    warned = wait_until(
        lambda: [s for m in ros.heard["/diagnostics"] for s in m.status if "cannot maintain the rate" in s.message],
        what="a warning",
    )
    assert all(s.level == b"\x01" for s in warned)
    assert process.end() == 0
    (late,) = re.findall(r"stopped after \d+ ticks, (\d+) late", process.said)
    assert int(late) >= before + 3
    assert_whole(only(bags))
    states = [r for r in bag.read(only(bags)) if r.topic == "/joint_states"]
    behind = [r.log_ns - stamp_ns(DECODE(r.data, r.type)) for r in states]  # by the simulator's own steady clock
    missed = 3 * (SECOND // 2 - SECOND // 100)
    assert behind[-1] - behind[0] > missed  # a stop is never made up for
    assert float(value(ros, "simulation", "lag [s]")) * SECOND > missed
    assert 0.0 < float(value(ros, "simulation", "real-time factor achieved")) < 1.0
    told = re.findall(r"simulated time lags (\d+\.\d{3}) s behind the clock, real-time factor 0\.\d{4}", process.said)
    assert sorted(map(float, told)) == [float(lag) for lag in told]  # the log repeats it as it grows
    assert float(told[-1]) * SECOND > missed


def test_late_ticks_are_caught_up_if_asked(ros):
    process = ros.simulator("late:=catch_up", hear=("joint_states", "/diagnostics"))
    wait_until(lambda: status(ros, "simulation"), what="diagnostics")
    before = int(value(ros, "simulation", "late ticks"))
    stop(process.process.pid)
    time.sleep(0.5)  # what it catches up
    process.process.send_signal(signal.SIGCONT)
    wait_until(lambda: int(value(ros, "simulation", "late ticks")) > before, what="a late tick")
    wait_until(lambda: float(value(ros, "simulation", "lag [s]")) < 0.3, what="a lag below what it missed")
    assert process.end() == 0


# -- starts that fail -------------------------------------------------------------------------------------------------

SCENES = {
    "no body": "{name: a, friction: {isotropic: 1}}",
    "an unknown key": "{name: a, bodyy: 1}",
    "a spring too weak": "{name: a, body: {contacts: [0, 1], links: {stiffness: -1}}, friction: {isotropic: 1}}",
    "no scene": "just text",
    "no YAML": "{name: [",
}


def test_a_start_that_fails_says_why_in_one_line_and_leaves_nothing(tmp_path):
    cases = [
        ["scene:=nowhere.yaml"],
        ["qos_overrides./joint_states.publisher.reliability:=maybe"],
        ["qos_overrides./joint_trajectory.subscription.depth:=-1"],
        ["qos_overrides./pose.publisher.depth:=lots"],
        ["view:=a.png"],
    ]
    for name, text in SCENES.items():
        (tmp_path / f"{name.replace(' ', '_')}.yaml").write_text(text)
        cases.append([f"scene:={tmp_path / name.replace(' ', '_')}.yaml"])
    running = []
    for case in cases:
        command = [*simulator(*case), "-p", f"record:={tmp_path / 'bags'}"]
        running.append(
            subprocess.Popen(command, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        )
    for case, process in zip(cases, running, strict=True):
        _, said = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 1, (case, said)
        assert len([line for line in said.splitlines() if line.startswith("simulator: ")]) == 1, (case, said)
        assert "Traceback" not in said, case
    assert not list((tmp_path / "bags").glob("*"))
    assert not list(tmp_path.rglob("*.mcap"))


def test_simulated_again_it_would_notice_a_bit(ros):
    """The check that the tests here stand on can fail."""
    bags = ros.folder / "bags"
    process = ros.simulator(f"record:={bags}")
    with driven(ros):
        wait_for_more(ros)
    assert process.end() == 0
    source = only(bags)
    head = bag.Bag({})
    records = list(bag.read(source, head))
    from crawler_ros.recording.bag_writer import BagWriter

    writer = BagWriter(ros.folder / "forged", head.attachments)
    channels = {}
    for record in records:
        if record.topic not in channels:
            channels[record.topic] = writer.add_channel(
                record.topic, record.type, record.schema.data, record.channel.metadata
            )
        data = bytearray(record.data)
        if record.topic == "/applied_commands" and (points := DECODE(record.data, record.type).points):
            data[data.find(struct.pack("<d", points[-1].positions[0]))] ^= 1  # the last bit of the last length
        writer.write(channels[record.topic], record.log_ns, record.publish_ns, bytes(data))
    writer.close()
    assert simulate_again(source).identical
    assert not simulate_again(ros.folder / "forged").identical
