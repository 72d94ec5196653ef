"""`crawler play --ros` moves a simulator in another process, holds without a page, and tells who else commands."""

from __future__ import annotations

import asyncio
import re
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("aiohttp")

import aiohttp
import numpy as np
from std_msgs.msg import Float64MultiArray

from crawler_lab.play.console import SLEW, open_console
from crawler_model import Crawler, load_scene

from ...lab.play.pages import browsing, complaint, next_frame, open_page
from ...processes import wait_until
from .graph import Graph, Process, graph

SCENE = "two_contacts_anisotropic"


def start(ros: Graph, scene: str = SCENE) -> str:
    """Start a console and return the address that it prints."""
    process: Process = ros.command("play", scene, "--ros")
    wait_until(lambda: "Ctrl-C" in process.said or process.process.poll() is not None, what="the address")
    return re.search(r"http://\S+", process.said)[0]


def talk(address: str, work: Any) -> Any:
    async def run() -> Any:
        async with aiohttp.ClientSession() as client, client.ws_connect(address.replace("/?", "/live?")) as page:
            return await asyncio.wait_for(work(page), 300)

    return asyncio.run(run())


def shows(text: str) -> Any:
    return lambda frame: any(text in line for line in frame["console"])


def applied(ros: Graph) -> list[Any]:
    """The commands that the simulator has followed."""
    return [point.positions for message in list(ros.heard["applied_commands"]) for point in message.points]


async def command(page: Any, values: dict[str, float], done: Any) -> dict[str, Any]:
    """Set values until a frame fits; on a busy machine the page may fall silent for a second, and the robot holds."""
    await page.send_json({"set": values})
    while not done(frame := await next_frame(page)):
        if frame["console"][1].startswith("holds"):
            await page.send_json({"set": values})
    return frame


def test_it_moves_a_simulator_in_a_straight_ramp_by_the_exact_amount(tmp_path):
    expected = Crawler(load_scene(SCENE))
    expected.advance([0.05])

    async def work(page: Any) -> None:
        await next_frame(page, shows("1 listener"))
        await next_frame(page, lambda frame: frame["words"].startswith("all feet hold"))
        there = pytest.approx(expected.displacement[1], abs=1e-12)
        frame = await command(page, {"link_0": 0.05}, lambda frame: frame["x"][1] == there)
        assert frame["x"][0] == 0.0
        assert frame["tension"] == pytest.approx(expected.tension, abs=1e-12)
        sent = int(re.match(r"(\d+) commands", frame["console"][0])[1])
        assert sent >= 0.05 / 0.3 / 0.5 / 0.1  # a ramp of a third of a second and more, a message each 0.1 s at least
        await page.send_json({"set": {"contact_0/backward": -1.0}})
        assert "friction must be >= 0" in await complaint(page)
        await command(page, {"contact_0/backward": 0.25}, lambda _: any(row[3] == 0.25 for row in applied(ros)))

    with graph(tmp_path) as ros:
        ros.simulator(f"scene:={SCENE}", hear=("joint_states", "applied_commands"))
        address = start(ros)
        talk(address, work)
        lengths = [row[0] for row in applied(ros)]
        assert lengths == sorted(lengths)
        assert lengths[-1] == 0.05


def test_the_last_command_of_a_ramp_is_no_further_than_the_others(tmp_path, monkeypatch):
    """At half the range of the slider per second, one and a half steps of a tenth of a second are two trajectories."""

    def applied_lengths() -> list[float]:
        return [row[0] for row in applied(ros)]

    with graph(tmp_path) as ros:
        ros.simulator(f"scene:={SCENE}", hear=("joint_states", "applied_commands"))
        monkeypatch.setenv("ROS_DOMAIN_ID", str(ros.domain))
        with open_console(load_scene(SCENE), "") as console:

            def is_answered() -> bool:
                console.advance(0.1)
                return console.received > 0 and console._publisher.get_subscription_count() > 0

            def is_there() -> bool:
                console.advance(0.1)
                return applied_lengths()[-1:] == [goal]

            wait_until(is_answered, what="a robot that answers")
            step = SLEW * 0.1 * console._ranges()[0]
            goal = 1.5 * step
            console.receive({"set": {"link_0": goal}})
            wait_until(is_there, what="the end of the ramp")
            assert console.sent == 2
        lengths = applied_lengths()
        assert lengths == sorted(lengths)
        assert (
            max(np.diff([0.0, *lengths])) < 1.001 * goal / 10
        )  # spread over ten ticks, even if one replaces the other


def test_it_shows_every_slip_though_many_come_between_two_frames(tmp_path, monkeypatch):
    lengths = [0.1 * (k % 2) for k in range(1, 41) for _ in range(2)]  # each second tick holds

    with graph(tmp_path) as ros:
        ros.simulator(f"scene:={SCENE}", "lock_step:=true", hear=("contact_states",))
        monkeypatch.setenv("ROS_DOMAIN_ID", str(ros.domain))
        with open_console(load_scene(SCENE), "") as console:

            def reads(count: int) -> Any:
                def is_read() -> bool:
                    console.advance(0.1)
                    return console.seen >= count

                return is_read

            wait_until(reads(1), what="the state at the start")
            for length in lengths:
                ros.publish("actuation_controller/commands", Float64MultiArray(data=[length]))
            wait_until(lambda: ros.heard["contact_states"][-1].header.stamp.nanosec == 800_000_000, what="all ticks")
            wait_until(reads(1 + len(lengths)), what="all states")
            fresh, past = console.past(None)
            known = console.place
        marks = [marks for _, _, marks in past[-len(lengths) :]]
        assert fresh
        assert marks[1::2] == [".."] * 40
        assert marks[0::2] == [".f", "f."] * 20
        assert console.past(known) == (False, [])


def test_after_a_reset_it_holds_and_begins_where_the_robot_did(tmp_path):
    async def work(page: Any) -> None:
        await next_frame(page, shows("1 listener"))
        await next_frame(page, lambda frame: frame["words"].startswith("all feet hold"))
        await command(page, {"link_0": 0.1}, lambda frame: frame["values"][0] == 0.1 and lengths()[-1:] == [0.1])
        reset = asyncio.create_task(asyncio.to_thread(ros.call, "/crawler/reset", "std_srvs/srv/Trigger"))
        await next_frame(page, lambda frame: reset.done() and begins_anew(frame))
        assert reset.result().success
        await command(page, {"link_0": 0.099}, lambda _: lengths()[-1:] == [0.099])

    def begins_anew(frame: dict[str, Any]) -> bool:
        # on a busy machine it may hold already, because the page was silent
        reasons = ("the robot began anew", "the page in control is silent")
        return any(shows(f"holds: {reason}")(frame) for reason in reasons) and frame["values"][0] == 0.0

    def lengths() -> list[float]:
        return [row[0] for row in applied(ros)]

    with graph(tmp_path) as ros:
        ros.simulator(f"scene:={SCENE}", hear=("joint_states", "applied_commands"))
        talk(start(ros), work)
        again = lengths()[lengths().index(0.1) + 1 :]
        again = [length for length in again if length != 0.1]
        assert len(again) > 3  # a third of the range of the slider takes more than half a second
        assert again == sorted(again)


def test_it_holds_when_the_robot_does_not_answer(tmp_path):
    async def work(page: Any) -> None:
        await next_frame(page, shows("1 listener"))
        await next_frame(page, lambda frame: frame["words"].startswith("all feet hold"))
        assert ros.call("/crawler/pause", "std_srvs/srv/SetBool", data=True).success
        await page.send_json({"set": {"link_0": 0.3}})
        await next_frame(page, shows("holds: the robot does not answer"))
        sent = len(lengths())
        await page.send_json({"set": {"link_0": 0.25}})
        assert "the robot does not answer" in await complaint(page)
        assert len(lengths()) == sent
        assert ros.call("/crawler/pause", "std_srvs/srv/SetBool", data=False).success
        await command(page, {"link_0": 0.2}, lambda _: lengths()[-1:] == [0.2])

    def lengths() -> list[float]:
        return [row[0] for row in applied(ros)]

    with graph(tmp_path) as ros:
        ros.simulator(f"scene:={SCENE}", hear=("joint_states", "applied_commands"))
        talk(start(ros), work)
        assert 0.0 < max(lengths()) < 0.3  # what was sent before it held


def test_the_first_ramp_begins_at_the_command_in_force(tmp_path):
    columns = load_scene("silicone_chain").columns
    friction, held = list(columns.names).index("contact_0/forward"), 0.02

    async def work(page: Any) -> None:
        await next_frame(page, lambda _: applied(ros) and applied(ros)[-1][0] == held)
        await next_frame(page, shows("1 listener"))
        await command(page, {"contact_0/forward": 0.4}, lambda _: applied(ros)[-1][friction] == 0.4)

    with graph(tmp_path) as ros:
        ros.simulator("scene:=silicone_chain", hear=("joint_states", "applied_commands"))
        address = start(ros, "silicone_chain")
        ros.publish("actuation_controller/commands", Float64MultiArray(data=[held] * 3))
        talk(address, work)
        first = next(i for i, row in enumerate(applied(ros)) if row[0] == held)
        assert [row[0] for row in applied(ros)[first:]] == pytest.approx([held] * (len(applied(ros)) - first), abs=1e-9)


def test_without_a_robot_and_with_another_one_nothing_is_sent(tmp_path):
    async def alone(page: Any) -> None:
        await next_frame(page, shows("0 listeners; 0 states"))
        await page.send_json({"set": {"link_0": 0.05}})
        assert "no robot answers on joint_states" in await complaint(page)

    async def other(page: Any) -> None:
        frame = await next_frame(page, lambda frame: frame["error"])
        assert "the robot differs from two_contacts_anisotropic" in frame["error"]
        assert frame["console"][0].startswith("0 commands")

    with graph(tmp_path) as ros:
        address = start(ros)
        talk(address, alone)
        ros.simulator("scene:=ten_contact_wave")
        talk(address, other)


def test_it_tells_who_else_commands(tmp_path):
    async def work(page: Any) -> None:
        await next_frame(page, shows("listener commands too, on actuation_controller/commands"))

    with graph(tmp_path) as ros:
        ros.simulator(f"scene:={SCENE}")
        address = start(ros)
        ros.publish("actuation_controller/commands", Float64MultiArray(data=[0.0]))
        talk(address, work)


def test_it_holds_when_the_page_is_killed(tmp_path):
    async def watch(page: Any) -> float:
        # a page that takes longer than a second to close has been silent before
        frame = await next_frame(page, shows("holds: the page in control"))
        sent, first = frame["console"][0].split()[0], frame["seen"]
        later = await next_frame(page, lambda later: later["seen"] > first + 300)
        # for three seconds, at a hundred states each; the wave would have changed in each frame
        assert later["console"][0].split()[0] == sent
        assert not later["playing"]
        return later["values"][0]

    with graph(tmp_path) as ros:
        ros.simulator(f"scene:={SCENE}", hear=("joint_states", "applied_commands"))
        address = start(ros)
        with browsing() as browser:
            page = open_page(browser, address)
            wait_until(lambda: page.evaluate("frame.words.startsWith('all feet hold')"), what="states")
            wait_until(lambda: page.evaluate("frame.console.join().includes('1 listener')"), what="a listener")
            # a robot has no other instant, and no sensor measures its work
            assert not [part for part in ("keep", "seeking", "lessons") if page.locator(f"#{part}").is_visible()]
            assert page.get_by_text("work [J]").count() == 0

            def moves() -> bool:
                page.evaluate("frame.playing || act({ mode: 'wave', play: true })")
                return page.evaluate("frame.playing && parseInt(frame.console[0]) > 0")

            wait_until(moves, what="commands that move it")
            browser.close()
        held = talk(address, watch)
        wait_until(lambda: applied(ros)[-1][0] == held, what="the command at which it holds")


def test_it_holds_when_the_page_falls_silent(tmp_path):
    with graph(tmp_path) as ros:
        ros.simulator(f"scene:={SCENE}")
        address = start(ros)

        async def silent() -> None:
            async with aiohttp.ClientSession() as client:
                live = address.replace("/?", "/live?")
                async with client.ws_connect(live + "&name=a") as page, client.ws_connect(live + "&name=b") as other:
                    await next_frame(page, lambda frame: frame["words"].startswith("all feet hold"))
                    await page.send_json({"mode": "wave", "play": True})
                    frame = await next_frame(other, shows("holds: the page in control is silent"))
                    sent, first = frame["console"][0].split()[0], frame["seen"]
                    later = await next_frame(other, lambda later: later["seen"] > first + 300)
                    assert later["console"][0].split()[0] == sent
                    assert not later["playing"]

        asyncio.run(asyncio.wait_for(silent(), 300))


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--ros", "--namespace", "le ft"), "--namespace: le ft: Invalid namespace"),
        (("--namespace", "/left"), "--namespace: /left; only a robot has one, add --ros"),
        (("--ros", "--state", "x"), "--state: only a simulated crawler can be put into a state"),
    ],
)
def test_a_mistake_is_answered_in_one_line(tmp_path, options, expected):
    with graph(tmp_path) as ros:
        process = ros.command("play", SCENE, *options)
        assert process.wait() == 1
        (line,) = process.said.splitlines()
        assert line.startswith(f"crawler: {expected}")
