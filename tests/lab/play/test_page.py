"""The page in a real Chromium: what a person does moves the crawler, exactly, and a keyboard is enough."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

pytest.importorskip("aiohttp")

from crawler_lab.play.lessons import read_lessons
from crawler_lab.play.session import Session
from crawler_lab.play.simulated import Simulated
from crawler_model import Crawler, Scene, load_scene, simulate

from .pages import browsing, open_page, served, wait_until


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with browsing() as found:
        yield found


@pytest.fixture
def play(browser: Any) -> Iterator[Any]:
    """Open a scene in a page; its context is closed and its script has not failed at the end."""
    opened: list[Any] = []

    def start(server: Any, **options: Any) -> Any:
        opened.append(open_page(browser, server.address, **options))
        return opened[-1]

    yield start
    for page in opened:
        assert page.problems == []
        page.context.close()


def tick_of(server: Any) -> int:
    return server.ask(lambda: server.robot.session.now)


def test_a_slider_moves_the_body_by_the_exact_amount(play):
    scene = load_scene("two_contacts_anisotropic")
    with served(Simulated(scene)) as server:
        page = play(server)
        page.get_by_label("link 0 in m").fill("0.0625")
        page.get_by_label("link 0 in m").press("Enter")
        wait_until(lambda: tick_of(server) == 1, "a tick")
        crawler = Crawler(scene)
        crawler.advance([0.0625])
        assert server.ask(lambda: server.robot.session.crawler.displacement.tolist()) == crawler.displacement.tolist()
        wait_until(lambda: page.evaluate("frame.x") == crawler.displacement.tolist(), "the same numbers in the page")
        page.locator("#words", has_text="foot 1 slides forward; 0 holds").wait_for()
        slider = page.get_by_label("link 0, slider")
        wait_until(lambda: float(slider.input_value()) == 0.0625, "the slider that follows the field")


def drag(page: Any, link: int, way: int) -> None:
    """Grab a link in its middle and drag it by some pixels."""
    (ax, ay), (bx, by) = page.evaluate(f"extent.springs[{link}].map(p => turned(p))")
    box = page.locator("#body").bounding_box()
    x, y = box["x"] + (ax + bx) / 2, box["y"] + (ay + by) / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + way, y, steps=4)
    page.mouse.up()


@pytest.mark.parametrize(("name", "link"), [("three_contacts_two_ways", 1), ("payload_climber", 0)])
def test_a_drag_takes_over_from_the_drive_and_moves_the_link_that_is_grabbed_and_undo_returns(play, name, link):
    with served(Simulated(load_scene(name))) as server:
        page = play(server)
        page.locator("#hint", has_text="Play, or drag a link").wait_for()
        scale = page.evaluate("extent.eye.scale")
        way = 40 * np.cos(np.radians(page.evaluate("frame.slope")))
        before = server.ask(lambda: server.robot.session.crawler.actuation.tolist())
        drag(page, link, 40)
        wait_until(lambda: page.get_by_role("radio", name="you").is_checked(), "the hand that leads")
        wait_until(
            lambda: (
                server.ask(lambda: server.robot.session.crawler.actuation[link])
                == pytest.approx(before[link] + way / scale)
            ),
            "the drag",
        )
        assert server.ask(lambda: server.robot.session.crawler.actuation.tolist())[:link] == before[:link]
        moved = tick_of(server)
        for k in range(moved):
            page.keyboard.press("u")
            wait_until(lambda k=k: tick_of(server) == moved - k - 1, "undo")
        assert server.ask(lambda: server.robot.session.crawler == Crawler(server.robot.session.scene))


def test_what_is_saved_simulates_to_the_same_displacement_to_the_bit(play, tmp_path):
    with served(Simulated(load_scene("three_contacts_two_ways"))) as server:
        page = play(server)
        page.get_by_role("button", name="Play").click()
        wait_until(lambda: tick_of(server) > 30, "some ticks")
        page.get_by_role("radio", name="a wave").click()
        page.get_by_label("amplitude").fill("0.06")
        page.get_by_label("amplitude").press("Enter")
        wait_until(lambda: server.ask(lambda: server.robot.session.tick.settings.wave.amplitude) == 0.06, "the wave")
        page.get_by_role("button", name="Pause").click()
        page.get_by_role("button", name="Play").wait_for()
        page.get_by_text("Save", exact=True).click()
        for kind in ("scene", "recording", "picture", "film"):
            with page.expect_download() as saved:
                page.get_by_role("button", name=f"Save {kind}").click()
            saved.value.save_as(tmp_path / saved.value.suggested_filename)
        run = simulate(load_scene(str(tmp_path / "three_contacts_two_ways_by_hand.yaml")))
        assert run.displacement[-1].tolist() == server.ask(lambda: server.robot.session.crawler.displacement.tolist())
        assert (tmp_path / "three_contacts_two_ways_by_hand.png").read_bytes().startswith(b"\x89PNG")
        assert "<script" in (tmp_path / "three_contacts_two_ways_by_hand.html").read_text()
        page.get_by_role("button", name="Copy link").click()
        link = page.get_by_label("link to this state").input_value()
        page.get_by_role("button", name="Reset").click()
        wait_until(lambda: tick_of(server) == 0, "the start")
        page.goto("about:blank")
        page.goto(link)
        wait_until(lambda: tick_of(server) == run.ticks, "the state of the link")
        assert run.displacement[-1].tolist() == server.ask(lambda: server.robot.session.crawler.displacement.tolist())


def test_what_jumps_lose_is_no_dissipation(play):
    robot = Simulated(load_scene("ice"))
    with served(robot) as server:
        page = play(server)
        wait_until(lambda: page.evaluate("frame.jump_loss") == 0.0, "a frame")
        lost = page.locator("#numbers div", has_text="lost in jumps [J]")
        assert lost.is_hidden()
        while not robot.session.tick.jumps:
            server.ask(robot.session.step)
        lost.wait_for()
        energy = simulate(robot.scene, tick_of(server) / 100.0).energy
        assert energy.jump_loss > 0.0
        np.testing.assert_allclose(
            page.evaluate("[frame.dissipation, frame.jump_loss]"), [energy.dissipation, energy.jump_loss], rtol=1e-9
        )


def test_a_keyboard_is_enough(play):
    with served(Simulated(load_scene("two_contacts_anisotropic"))) as server:
        page = play(server)
        page.keyboard.press(".")
        wait_until(lambda: tick_of(server) == 1, "a step")
        page.keyboard.press(" ")
        wait_until(lambda: tick_of(server) > 5, "playing")
        page.keyboard.press(" ")
        wait_until(lambda: not server.ask(lambda: server.robot.session.playing), "a pause")
        page.keyboard.press("r")
        wait_until(lambda: tick_of(server) == 0, "the start")
        page.keyboard.press("1")
        wait_until(lambda: page.get_by_role("radio", name="you").is_checked(), "the hand")
        reached = set()
        for _ in range(60):
            page.keyboard.press("Tab")
            reached.add(
                page.evaluate(
                    "document.activeElement.id || document.activeElement.ariaLabel || document.activeElement.textContent"
                )
            )
            if "link 0, slider" in reached:
                break
        page.keyboard.press("ArrowRight")
        step = page.evaluate("(scene.controls[0].most - scene.controls[0].least) / 100")
        wait_until(
            lambda: server.ask(lambda: server.robot.session.settings.hand[0]) == pytest.approx(step), "the slider"
        )
        assert {"play", "step", "undo", "reset", "seek"} <= reached
        unnamed = page.evaluate(
            "[...document.querySelectorAll('button, input, summary')].filter(e => e.checkVisibility() && !e.textContent.trim()"
            " && !e.ariaLabel && !(e.labels && [...e.labels].some(l => l.textContent.trim()))).map(e => e.outerHTML)"
        )
        assert unnamed == []


def test_a_lesson_opens_in_the_running_page_and_its_steps_are_there(play):
    lesson = read_lessons()["stalled_motor"]
    with served(Simulated(load_scene("two_contacts_anisotropic"))) as server:
        page = play(server)
        page.get_by_text("Lessons").press("Enter")
        page.get_by_role("button", name=lesson.title).press("Enter")
        page.get_by_role("heading", name=lesson.title).wait_for()
        assert page.evaluate("document.activeElement.textContent") == lesson.title  # from there Tab goes on
        assert page.locator("#lesson li").all_text_contents() == list(lesson.steps)
        shown = page.locator("#lesson li:visible")
        for step in lesson.steps:
            assert shown.all_inner_texts() == [step]
            page.get_by_role("button", name="Next step").click(force=True)
        session = Session(load_scene(lesson.scene))
        session.restore(lesson.state)
        wait_until(lambda: page.evaluate("frame && frame.x") == session.crawler.displacement.tolist(), "its instant")
        page.get_by_label("link 0 in m").fill("1")
        page.get_by_label("link 0 in m").press("Enter")
        page.locator("#words", has_text="link 0 is stalled").wait_for()


def test_reloading_keeps_the_hand_and_the_past(play):
    with served(Simulated(load_scene("two_contacts_anisotropic"))) as server:
        page = play(server)
        for _ in range(3):
            page.keyboard.press(".")
        wait_until(lambda: tick_of(server) == 3, "three ticks")
        page.reload()
        wait_until(lambda: page.evaluate("window.drawn > 1 && past.length == 3 && hand"), "the same page")


def test_a_link_that_waits_for_the_hand_is_announced(play):
    with served(Simulated(load_scene("two_contacts_anisotropic"))) as server:
        first, other = play(server), play(server)
        other.evaluate("history.replaceState(null, '', location.pathname + location.search + '#state=x')")
        first.keyboard.press(".")
        other.locator("#error", has_text="this link replaces the session as soon as you take control").wait_for()


def test_a_drag_without_control_is_answered(play):
    with served(Simulated(load_scene("two_contacts_anisotropic"))) as server:
        _, other = play(server), play(server)
        drag(other, 0, 20)
        other.locator("#error", has_text="another page controls it: take control first").wait_for()
        other.get_by_role("button", name="Take control").click()
        other.locator("#link", has_text="you control it").wait_for()
        drag(other, 0, 20)
        wait_until(lambda: tick_of(server) > 0, "the drag")


def test_nothing_comes_from_elsewhere_and_no_other_page_can_move_it(play, browser):
    with served(Simulated(load_scene("two_anchor_a"))) as server:
        page = play(server)
        wanted = page.evaluate("performance.getEntriesByType('resource').map(e => e.name)")
        assert all(name.startswith(("data:", "ws:", f"http://127.0.0.1:{server.port}/")) for name in wanted)
        other = browser.new_context().new_page()
        other.goto("data:text/html,<title>elsewhere</title>")
        opened = other.evaluate(
            "address => new Promise(done => { const s = new WebSocket(address); s.onopen = () => done(true); s.onerror = () => done(false); })",
            server.address.replace("http", "ws").replace("/?", "/live?"),
        )
        assert opened is False
        other.context.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1440, 420])
def test_every_kind_of_body_is_drawn_in_light_and_dark_wide_and_narrow(play, scheme, width):
    names = ("three_contacts_two_ways", "payload_climber", "planar_three_points", "steering_inchworm")
    for name in names if width == 1440 else names[::3]:
        with served(Simulated(load_scene(name))) as server:
            page = play(server, color_scheme=scheme)
            page.set_viewport_size({"width": width, "height": 900})
            page.keyboard.press(" ")
            wait_until(lambda: tick_of(server) > 20, "motion")
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            if width == 1440:  # all pictures are seen at once
                assert page.evaluate("document.documentElement.scrollHeight") <= 900
            else:  # the body stays in sight of the sliders
                page.locator("#controls input").last.scroll_into_view_if_needed()
                assert page.locator("#body").bounding_box()["y"] >= 0.0
            shades = page.evaluate(
                "new Set(new Uint32Array(at('body').getContext('2d').getImageData(0, 0, at('body').width, at('body').height).data.buffer)).size"
            )
            assert shades > 3
            dark = page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(22, 25, 28)"
            assert dark == (scheme == "dark")


def test_a_page_plays_a_first_period_and_then_invites_and_a_drag_takes_over_while_it_plays(play):
    robot = Simulated(load_scene("three_contacts_two_ways"))
    robot.receive({"speed": 1e-6})  # the period does not end before its hint is seen
    with served(robot) as server:
        page = play(server, reduced_motion="no-preference")
        page.locator("#hint", has_text="Its drive moves it: drag a link to take over").wait_for()
        server.ask(lambda: robot.receive({"speed": 1.0}))
        page.locator("#hint", has_text="Play, or drag a link").wait_for()
        assert tick_of(server) >= 100
        assert not server.ask(lambda: server.robot.session.playing)
        page.keyboard.press(" ")
        wait_until(lambda: page.evaluate("frame.playing"), "the drive")
        before = page.evaluate("frame.tick")
        drag(page, 0, 60)
        wait_until(lambda: page.evaluate(f"frame.mode == 'hand' && frame.playing && frame.tick > {before}"), "the hand")
        page.locator("#hint").wait_for(state="hidden")


def test_picture_and_sentence_change_together(play):
    with served(Simulated(load_scene("three_contacts_two_ways"))) as server:
        page = play(server)
        page.evaluate(
            "window.pairs = []; const sent = send;"
            "send = message => { if (message.seen) pairs.push([at('words').textContent, frame.words]); sent(message); }; 0"
        )
        page.keyboard.press(" ")
        pairs = wait_until(lambda: len(found := page.evaluate("pairs")) > 40 and found, "forty pictures")
        assert all(told == drawn for told, drawn in pairs)
        assert len({told for told, _ in pairs}) > 5


def test_a_body_that_turns_has_a_path_a_heading_and_its_passive_sliders_in_a_group(play):
    with served(Simulated(load_scene("steering_inchworm"))) as server:
        page = play(server)
        page.keyboard.press(" ")
        wait_until(lambda: tick_of(server) > 40, "motion")
        page.keyboard.press(" ")
        wait_until(lambda: page.evaluate(f"!frame.playing && past.length == {tick_of(server)}"), "a pause")
        path = page.evaluate("past.map(p => p[1])")
        assert path[-1] == page.evaluate("frame.net") == server.ask(lambda: server.robot.session.tick.net.tolist())
        heading = page.locator("#numbers div", has_text="heading [°]").locator("dd")
        told = np.degrees(server.ask(lambda: server.robot.session.crawler.yaw))
        wait_until(lambda: float(heading.inner_text()) == pytest.approx(told, rel=5e-3), "the heading")
        groups = page.locator("#controls details")
        assert [group.locator(".control").count() for group in groups.all()] == [2, 6, 16]
        assert [group.get_attribute("open") is not None for group in groups.all()] == [True, False, False]


def test_a_hundred_contacts_are_drawn(play):
    document = {
        "name": "hundred",
        "body": {"contacts": [0.1 * i for i in range(100)], "links": {"stiffness": 20.0}},
        "friction": {"forward": 0.02, "backward": 0.05},
        "start": "relaxed",
        "drive": {"wave": {"amplitude": 0.01, "wavelength": 2.0, "period": 1.0}},
    }
    with served(Simulated(Scene.model_validate(document))) as server:
        page = play(server)
        page.keyboard.press(" ")
        drawn = page.evaluate("window.drawn")
        wait_until(lambda: page.evaluate("window.drawn") > drawn + 10, "ten frames")
        assert page.evaluate("frame.x.length") == 100
