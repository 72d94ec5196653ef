"""The server by a real client: who may see a robot, who may move it, and what a gap loses."""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

pytest.importorskip("aiohttp")

import aiohttp
import numpy as np

from crawler_lab.play.server import Server
from crawler_lab.play.simulated import Simulated
from crawler_model import CrawlerError, Scene, load_scene

from ...sockets import addresses
from .pages import complaint, next_frame

Work = Callable[[Server, Any], Awaitable[None]]


def serve(work: Work, scene: str = "two_contacts_anisotropic") -> None:
    async def run() -> None:
        server = Server(Simulated(load_scene(scene)))
        runner = await server.start()
        try:
            async with aiohttp.ClientSession() as client:
                await asyncio.wait_for(work(server, client), 300)
        finally:
            await runner.cleanup()

    asyncio.run(run())


def url(server: Server, path: str = "live", **more: str) -> str:
    query = "&".join(f"{key}={value}" for key, value in {"token": server.token, **more}.items())
    return f"http://127.0.0.1:{server.port}/{path}?{query}"


def test_foreign_origins_hosts_and_tokens_are_refused():
    async def work(server: Server, client: Any) -> None:
        port = server.port
        allowed = [{}, {"Origin": f"http://127.0.0.1:{port}"}, {"Host": f"localhost:{port}"}]
        refused = [
            ({"Origin": "http://evil.example"}, "Origin: another page"),
            ({"Origin": "null"}, "Origin: another page"),
            ({"Origin": f"http://127.0.0.1:{port + 1}"}, "Origin: another page"),
            ({"Host": f"rebound.example:{port}"}, "Host: use the address"),
            ({"Host": "127.0.0.1"}, "Host: use the address"),
        ]
        for path in ("", "live", "keep/scene.yaml"):
            for headers, text in refused:
                async with client.get(url(server, path), headers=headers) as answer:
                    assert (answer.status, text in await answer.text()) == (403, True)
            for token in ("", "wrong", server.token[:-1]):
                async with client.get(f"http://127.0.0.1:{port}/{path}", params={"token": token}) as answer:
                    assert (answer.status, "token: it is missing or wrong" in await answer.text()) == (403, True)
            with pytest.raises(aiohttp.WSServerHandshakeError):
                await client.ws_connect(url(server), headers={"Origin": "https://evil.example"})
        for headers in allowed:
            async with client.get(url(server, ""), headers=headers) as answer:
                assert answer.status == 200
                policy = answer.headers["Content-Security-Policy"]
                assert "default-src 'none'" in policy
                assert "frame-ancestors 'none'" in policy
        assert server.robot.frame()["tick"] == 0

    serve(work)


def test_it_listens_on_loopback_alone():
    async def work(server: Server, client: Any) -> None:
        import os

        own = {address for _, address, port in addresses(os.getpid()) if port == server.port}
        assert own == {"127.0.0.1"}
        with pytest.raises(CrawlerError, match=f"--port: {server.port} on 127.0.0.1: address already in use; leave"):
            await Server(server.robot).start(server.port)

    serve(work)


def test_many_pages_see_one_robot_and_one_has_the_hand():
    async def work(server: Server, client: Any) -> None:
        async with (
            client.ws_connect(url(server, name="a")) as first,
            client.ws_connect(url(server, name="b")) as second,
        ):
            assert (await next_frame(first))["hand"]
            assert not (await next_frame(second))["hand"]
            await second.send_json({"step": 1})
            assert await complaint(second) == "another page controls it; take control first"
            await first.send_json({"step": 1})
            seen = [await next_frame(page, lambda frame: frame["tick"] == 1) for page in (first, second)]
            assert seen[0]["x"] == seen[1]["x"]
            await second.send_json({"take": True})
            await second.send_json({"mode": "hand"})
            await second.send_json({"set": {"link_0": 0.05}})
            frame = await next_frame(second, lambda frame: frame["tick"] == 2)
            assert frame["hand"]
            assert frame["pages"] == 2
            await next_frame(first, lambda frame: not frame["hand"])
            await first.send_json({"play": True})
            assert "another page controls it" in await complaint(first)

    serve(work)


def test_a_lesson_opens_in_all_pages_even_in_one_that_had_not_answered():
    async def work(server: Server, client: Any) -> None:
        async with (
            client.ws_connect(url(server, name="a")) as page,
            client.ws_connect(url(server, name="slow")) as slow,
        ):
            await page.send_json({"play": True})
            while server.robot.session.now < 10 or next(c for c in server.clients if c.name == "slow").sent < 2:
                await next_frame(page)
            await slow.send_json({"lesson": "slack_tendon"})
            assert "another page controls it" in await complaint_unanswered(slow)
            await page.send_json({"lesson": "slack_tendon"})
            for one in (page, slow):
                while "scene" not in (message := await one.receive_json()) or message["scene"]["name"] != "tendon_worm":
                    pass
                assert message["scene"]["lesson"]["title"] == "A tendon that goes slack"
                frame = await next_frame(one)
                assert frame["fresh"]
                assert len(frame["x"]) == len(message["scene"]["contacts"])
                assert frame["words"].endswith("link 0 is slack")

    async def complaint_unanswered(page: Any) -> str:
        while "error" not in (message := await page.receive_json()) or "frame" in message:
            pass
        return message["error"]

    serve(work)


def test_closing_a_page_and_a_gap_lose_nothing():
    async def work(server: Server, client: Any) -> None:
        async with client.ws_connect(url(server, name="a")) as page:
            await page.send_json({"play": True})
            await next_frame(page, lambda frame: frame["tick"] >= 20)
        while server.clients:
            await asyncio.sleep(0.01)
        before = server.robot.session.now
        while server.robot.session.now < before + 10:  # it goes on without a page
            await asyncio.sleep(0.01)
        async with client.ws_connect(url(server, name="a")) as page:
            frame = await next_frame(page)
            assert frame["hand"]
            assert frame["fresh"]
            assert len(frame["past"]) == frame["tick"] >= before + 10
            later = await next_frame(page, lambda later: later["tick"] > frame["tick"])
            assert not later["fresh"]
            async with client.ws_connect(url(server, name="a")) as again:  # the old connection only seems to live
                assert (await next_frame(again))["hand"]
                while (message := await page.receive()).type is not aiohttp.WSMsgType.CLOSE:
                    pass
                assert message.data == 4001

    serve(work)


def test_a_page_that_does_not_answer_receives_no_more_frames_and_holds_nobody_up():
    async def work(server: Server, client: Any) -> None:
        async with (
            client.ws_connect(url(server, name="a")) as page,
            client.ws_connect(url(server, name="slow")) as slow,
        ):
            await page.send_json({"play": True})
            await next_frame(page, lambda frame: frame["tick"] >= 50)
            client_of_slow = next(c for c in server.clients if c.name == "slow")
            assert client_of_slow.sent == 2
            for _ in range(3):
                await slow.receive_json()
            await slow.send_json({"seen": 2})
            frame = await next_frame(slow)
            assert frame["tick"] >= 50

    serve(work)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("{", "message: it must be a JSON object"),
        ("[1]", "message: it must be a JSON object"),
        ("[" * 100_000, "message: it must be a JSON object"),
        ('{"set": {"link_0": 1' + "0" * 400 + "}}", "it must be a finite number"),
        ('{"seek": 5}', "seek: tick 5; it must be between 0 and 0"),
        ('{"seek": 0.5}', "seek: 0.5; it must be the number of a tick"),
        ('{"speed": 0}', "speed: 0; it must be above 0 and at most 100"),
        ('{"set": {"link_9": 1}}', "link_9: no such control"),
        ('{"restore": "x"}', "link: it is damaged"),
        ('{"lesson": "x"}', "lesson: 'x'; the lessons are why_it_does_not_move, stasis_polygon"),
    ],
)
def test_a_bad_message_is_answered_and_changes_nothing(text, expected):
    async def work(server: Server, client: Any) -> None:
        async with client.ws_connect(url(server)) as page:
            before = json.dumps(server.robot.frame())
            await page.send_str(text)
            assert expected in await complaint(page)
            assert json.dumps(server.robot.frame()) == before

    serve(work)


def test_what_is_kept_is_sent_as_a_file():
    async def work(server: Server, client: Any) -> None:
        async with client.get(url(server, "keep/scene.yaml")) as answer:
            assert (answer.status, await answer.text()) == (
                409,
                "save: nothing has happened yet; play, or move a slider\n",
            )
        server.robot.receive({"step": 1})
        async with client.get(url(server, "keep/scene.yaml")) as answer:
            assert answer.headers["Content-Disposition"].endswith('"two_contacts_anisotropic_by_hand.yaml"')
            assert "drive:" in await answer.text()
        async with client.get(url(server, "keep/shadow")) as answer:
            assert answer.status == 404

    serve(work)


@pytest.mark.parametrize("name", ["../up", "/tmp/victim", "stroke 1/2", 'a "b"', "x" * 260])
def test_no_name_of_a_scene_leads_out_of_the_folder_of_what_is_kept(tmp_path, name):
    robot = Simulated(Scene.model_validate(load_scene("two_contacts_anisotropic").document() | {"name": name}))
    robot.receive({"step": 1})
    for kind in ("scene.yaml", "recording.mcap"):
        file = robot.keep(kind, tmp_path)()
        assert file.parent == tmp_path
        assert re.fullmatch(r"[\w.-]+_by_hand\.\w+", file.name)
        assert file.stat().st_size > 0


def test_words_tell_what_happens():
    robot = Simulated(load_scene("two_contacts_anisotropic"))
    assert robot.frame()["words"] == "all feet hold; margin 0.2 N (foot 0, nearest to sliding forward)"
    robot.receive({"mode": "hand"})
    robot.receive({"set": {"link_0": 0.02}})
    assert robot.frame()["words"] == "foot 1 slides forward; 0 holds; margin 0.3 N"
    segment = Simulated(load_scene("continuous_segment"))
    for _ in range(20):
        segment.receive({"step": 1})
    assert segment.frame()["words"] == "feet 10 to 38 slide forward; feet 0 to 9 slide back"
    slack = Simulated(load_scene("tendon_worm"))
    slack.receive({"mode": "hand"})
    slack.receive({"set": {"link_0": 0.5}})
    assert slack.frame()["words"].endswith("link 0 is slack")


@pytest.mark.parametrize(
    ("load", "link", "margin", "more", "way"),
    [
        (0.25, 0.002, 0.161, 0.2, "forward"),  # the link pushes contact 0 back
        (0.25, -0.004, 0.0406, 0.05, "forward"),
        (-0.55, -0.002, 0.104, -0.15, "back"),  # the link pulls contact 0 forward
        (-0.55, 0.002, 0.0242, -0.05, "back"),
    ],
)
def test_the_sentence_names_the_way_in_which_the_nearest_contact_slides(load, link, margin, more, way):
    """The nearest bound decides: loads and friction that differ by direction put either nearer, whatever the force."""
    robot = Simulated(load_scene("slope_climber"))
    robot.receive({"mode": "hand"})
    robot.receive({"set": {"contact_0/load": load, "link_0": link}})
    assert robot.frame()["words"] == f"all feet hold; margin {margin} N (foot 0, nearest to sliding {way})"
    robot.receive({"set": {"contact_0/load": load + more}})
    assert robot.frame()["words"].startswith(f"foot 0 slides {way}; 1 holds; ")


@pytest.mark.parametrize("name", ["two_anchor_a", "three_contacts_two_ways"])
def test_each_side_of_the_domain_is_where_its_foot_slides(name):
    """Whenever one foot alone slides, the tensions are on its side of the domain, which has the colour of its way."""
    robot, seen = Simulated(load_scene(name)), 0
    for _ in range(150):
        robot.receive({"step": 1})
        frame = robot.frame()
        for direction, foot, a, b in frame["sides"] if np.count_nonzero(frame["state"]) == 1 else []:
            if frame["state"][foot] == direction:
                a, b, point = (np.array(p) for p in (a, b, frame["tension"]))
                part = (point - a) @ (b - a) / max((b - a) @ (b - a), 1e-300)
                assert point == pytest.approx(a + part * (b - a), abs=1e-9)
                assert -1e-9 <= part <= 1.0 + 1e-9
                seen += 1
    assert seen > 30
