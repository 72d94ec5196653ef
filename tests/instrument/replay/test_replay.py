"""What `crawler replay` finds in made-up and in damaged recordings; recordings of real runs are in `tests/instrument/ros`."""

from __future__ import annotations

import itertools
import json
import struct
from pathlib import Path

import mcap.reader
import mcap.writer
import numpy as np
import pytest
import yaml

from crawler_command.screen import Screen
from crawler_lab.identify.recorded import read_bag
from crawler_model import Scene, load_scene, simulate
from crawler_model.body.drive import NS
from crawler_ros.recording import bag
from crawler_ros.recording.bag import BagError
from crawler_ros.recording.bag_writer import BagWriter
from crawler_ros.recording.incidents import find_incidents
from crawler_ros.replay import analyse, simulate_again
from crawler_ros.replay.health import survey_recording
from crawler_ros.replay.ramps import RampTable
from crawler_ros.replay.rests import Rest
from crawler_ros.replay.show.report import print_replay
from crawler_ros.wire.topics import read_topics

from ...commands import crawler
from ...recordings import STATES, attachments, hold, messages, play, record, rewrite, write


def test_strategy_b_slips_the_wrong_way_first(tmp_path):
    """Beyond k Lmax = 3 mu what more amplitude gains it loses in the slide back that begins each half period."""
    found = analyse(record(tmp_path / "b", "two_anchor_b", 3))
    lost = [s for s in found.as_plain()["slips"] if s["direction"] == -1]
    assert len(lost) == 6
    assert found.cycles[0].slip_backward == pytest.approx(1.0)
    assert found.cycles[0].slip_forward == pytest.approx(5.0)
    assert found.cycles[0].translation == pytest.approx(2.0)


def test_the_first_cycle_from_rest_is_a_transient(tmp_path):
    found = analyse(record(tmp_path / "a", "three_contacts_one_way", 4))
    assert [c.transient for c in found.cycles] == [True, False, False, False]
    assert found.cycles[0].translation != pytest.approx(0.14)
    assert [c.translation for c in found.cycles[1:]] == pytest.approx([0.14] * 3)
    screen = Screen(width=200, record=True)
    print_replay(found, screen)
    assert "transient: a cycle whose shape or translation differs from the steady one" in screen.export_text()


def test_a_cycle_within_a_thousandth_of_the_steady_one_is_no_transient(tmp_path):
    """The motors of this body stall; its gain approaches the steady one by half in a period."""
    document = load_scene("peristaltic_stops").document() | {"start": "relaxed"}
    document["drive"]["actuation"] = (0.3 * np.array(document["drive"]["actuation"])).tolist()
    found = analyse(record(tmp_path / "a", Scene.model_validate(document), 10))
    gained = np.array([cycle.translation for cycle in found.cycles])
    off = np.abs(gained / gained[-1] - 1.0)
    transient = np.array([cycle.transient for cycle in found.cycles])
    assert transient.tolist() == sorted(transient, reverse=True)
    assert transient[off > 1e-3].all()
    assert off[~transient][:-1].min() > 1e-5


def test_ticks_with_waypoints_inside_are_followed_exactly(tmp_path):
    found = analyse(record(tmp_path / "b", "two_anchor_a", 4, rate=7.0, wait=1.0), None)
    assert found.comparison.identical
    assert [c.translation for c in found.cycles] == pytest.approx([2.0] * 4)


def unchanged(name, stamp, data):
    return [(name, stamp, data)]


def bare(source: Path, folder: Path, change=unchanged, compression=mcap.writer.CompressionType.ZSTD) -> Path:
    """What `ros2 bag record` would have written: by mcap's own writer, without attachments."""
    folder.mkdir()
    with (folder / f"{folder.name}_0.mcap").open("wb") as stream:
        writer = mcap.writer.Writer(stream, compression=compression, chunk_size=50_000)
        writer.start("ros2", "libmcap")
        channels: dict[str, int] = {}
        from crawler_ros.wire.messages import read_stamp

        for r in bag.read(source):
            if r.topic not in channels:
                schema = writer.register_schema(r.type, "ros2msg", r.schema.data)
                channels[r.topic] = writer.register_channel(r.topic, "cdr", schema, dict(r.channel.metadata))
            for _, _, data in change(r.topic[1:], read_stamp(r.data), r.data):
                writer.add_message(channels[r.topic], r.log_ns, data, r.publish_ns)
        writer.finish()
    return folder


@pytest.mark.parametrize("compression", [*mcap.writer.CompressionType])
def test_a_recording_without_attachments_is_simulated_again_with_its_scene(tmp_path, compression):
    path = bare(record(tmp_path / "a", "two_anchor_a", 3), tmp_path / "bare", compression=compression)
    alone = analyse(path)
    assert alone.comparison is None
    assert "--scene" in alone.explanation
    # what was commanded before the first command is not recorded, so that the first whole cycle begins behind it
    assert [c.translation for c in alone.cycles] == pytest.approx([2.0] * 2)
    assert alone.cycles[0].energy is None
    assert alone.problems == ()
    json.dumps(alone.as_plain(), allow_nan=False)
    known = analyse(path, load_scene("two_anchor_a"))
    assert known.comparison.identical
    assert known.problems == ()
    assert known.cycle_source == "drive"
    slips = [[(s["contact"], s["direction"], s["start"]) for s in f.as_plain()["slips"]] for f in (alone, known)]
    assert slips[0] == slips[1]


def test_the_wrong_scene_is_named(tmp_path):
    path = bare(record(tmp_path / "a", "two_anchor_a", 1), tmp_path / "bare")
    with pytest.raises(BagError, match="this is not the recorded scene"):
        analyse(path, load_scene("three_contacts_one_way"))


@pytest.mark.parametrize(
    ("name", "cut_ns"),
    [("two_anchor_a", 1_000_000_000), ("tendon_worm", 2_200_000_000), ("stalling_inchworm", 1_000_000_000)],
)
def test_a_recording_that_begins_in_mid_run_is_compared_from_a_state_that_it_holds(name, cut_ns, tmp_path):
    """Recordings of actuators with limits begin while the tendon is slack or the motor stalled."""
    late = lambda name, stamp, data: [(name, stamp, data)] * (stamp >= cut_ns)  # noqa: E731
    path = bare(record(tmp_path / "a", name, 4), tmp_path / "bare", late)
    found = analyse(path, load_scene(name))
    assert found.fitted_ns == cut_ns + 10_000_000
    assert found.comparison.max_difference < 1e-12
    assert found.comparison.ticks > 300
    assert "begins in mid-run" in found.explanation
    assert found.problems == ()
    assert found.cycles[-1].translation == pytest.approx(simulate(load_scene(name), duration=8.0).per_period[-1])


def test_a_recording_that_begins_in_mid_run_and_is_reset_begins_in_the_first_run(tmp_path):
    """The stamps of the second run begin at 0 again, and so does its state."""
    scene = load_scene("two_anchor_a")
    sent = list(messages(scene, play(scene, 0, 4 * NS)))
    late = [message for message in sent if message[1] >= NS]
    found = analyse(write(tmp_path / "a", [*late, *sent], {}), scene)
    assert found.fitted_ns == NS + 10_000_000
    assert (found.comparison.resets, found.comparison.missing, found.comparison.unmatched) == (
        1,
        0,
        3,
    )  # the state it begins with, thrice
    assert found.comparison.max_difference < 1e-12
    assert found.problems == ()


def test_a_reset_before_any_command_of_a_mid_run_is_named(tmp_path):
    scene = load_scene("two_anchor_a")
    sent = list(messages(scene, play(scene, 0, NS)))
    late = [message for message in messages(scene, hold(0, 100)) if message[1] >= NS // 2]
    found = analyse(write(tmp_path / "a", [*late, *sent], {}), scene)
    assert found.comparison is None
    assert "nothing is commanded in it before it is reset" in found.explanation


def test_of_states_that_were_published_now_and_then_none_is_missing(tmp_path):
    """`publish.every` is a parameter, and `ros2 bag record` records none."""
    every = 7
    keep = lambda name, stamp, data: [(name, stamp, data)] * (name not in STATES or stamp % (every * 10**7) == 0)  # noqa: E731
    lose = lambda name, stamp, data: keep(name, stamp, data) * (name != "pose" or stamp != every * 10**8)  # noqa: E731
    source, scene = record(tmp_path / "a", "two_anchor_a", 2), load_scene("two_anchor_a")
    found = analyse(bare(source, tmp_path / "bare", keep), scene)
    assert found.problems == ()
    assert found.comparison.identical
    found = analyse(bare(source, tmp_path / "lost", lose), scene)
    assert [name for name, topic in found.topics.items() if topic.missing] == ["/pose"]


def test_times_at_limits_are_those_of_the_table_of_the_run(tmp_path):
    for name, word in (("tendon_worm", "slack"), ("stalling_inchworm", "stalled")):
        found = analyse(record(tmp_path / name, name, 2, wait=0.0))
        run = simulate(load_scene(name), duration=4.0, rate=100.0)
        ticks = np.asarray(run.to_table()[f"link_0/{word}"])[1:].sum()
        assert found.as_plain()["at_limits"] == {"link_0": {word: pytest.approx(ticks / 100.0)}}
    assert analyse(record(tmp_path / "two", "two_anchor_a", 1)).at_limits == {}


def test_mid_run_without_states_says_what_is_missing(tmp_path):
    keep = lambda name, stamp, data: [(name, stamp, data)] * (stamp >= 10**9 and name == "applied_commands")  # noqa: E731
    path = bare(record(tmp_path / "a", "two_anchor_a", 2), tmp_path / "bare", keep)
    with pytest.raises(BagError, match="neither contact_states nor joint_states was recorded"):
        analyse(path, load_scene("two_anchor_a"))


def test_a_missing_ledger_message_is_located_and_explained(tmp_path):
    drop = lambda name, stamp, data: [(name, stamp, data)] * (name != "applied_commands" or stamp != 790_000_000)  # noqa: E731
    source = record(tmp_path / "a", "two_anchor_b", 2)
    path = rewrite(source, tmp_path / "b", drop, survey_recording(source).attachments)
    found = analyse(path)
    assert not found.comparison.identical
    assert found.comparison.missing == 1
    assert found.comparison.missing_at == pytest.approx(0.79)
    assert "1 ledger message(s) missing from 0.79 s on" in found.explanation
    assert found.topics["/applied_commands"].gaps == ((0.78, 0.8, 1),)
    assert not found.healthy


def test_a_changed_state_is_found_at_its_time_and_place(tmp_path):
    def change(name, stamp, data):
        if name == "joint_states" and stamp == 1_230_000_000:
            data = bytearray(data)
            place = len(data) - 8 * 6 - 2 * 8 + 8  # somewhere in the numbers
            data[place] ^= 1
            data = bytes(data)
        return [(name, stamp, data)]

    source = record(tmp_path / "a", "two_anchor_a", 2)
    path = rewrite(source, tmp_path / "b", change, survey_recording(source).attachments)
    found = analyse(path)
    assert found.comparison.first_difference == pytest.approx(1.23)
    assert found.comparison.max_difference < 1e-9
    assert "joint_states" in found.comparison.first_where


@pytest.mark.parametrize(
    ("topic", "from_the_end", "where"),
    [("joint_states", 32, "joint_states link_0 velocity"), ("pose", 56, "pose x position")],
)
def test_every_number_of_a_state_is_compared(tmp_path, topic, from_the_end, where):
    def change(name, stamp, data):
        if name == topic and stamp == 1_230_000_000:
            place = len(data) - from_the_end
            (number,) = struct.unpack_from("<d", data, place)
            data = data[:place] + struct.pack("<d", np.nextafter(number, 9.0)) + data[place + 8 :]
        return [(name, stamp, data)]

    source = record(tmp_path / "a", "two_anchor_a", 2)
    assert analyse(source).comparison.identical
    found = analyse(rewrite(source, tmp_path / "b", change, survey_recording(source).attachments)).comparison
    assert found.first_difference == pytest.approx(1.23)
    assert found.first_where.startswith(where)


def test_another_version_is_named(tmp_path):
    scene = load_scene("two_anchor_a")
    attached = attachments(scene)
    attached["versions"] = {**attached["versions"], "numpy": "1.0"}
    other = load_scene("two_anchor_b")
    sent = messages(other, play(other, 0, 10**9))
    found = analyse(write(tmp_path / "a", sent, attached))
    assert "recorded with numpy 1.0" in found.explanation
    assert not found.healthy


@pytest.mark.parametrize("version", ["0.1.0", None])
def test_rounding_is_no_problem_in_a_recording_of_another_version(tmp_path, version):
    def change(name, stamp, data):
        if name == "joint_states" and stamp == 1_230_000_000:
            place = len(data) - 8  # an effort
            (number,) = struct.unpack_from("<d", data, place)
            data = data[:place] + struct.pack("<d", np.nextafter(number, 9.0)) + data[place + 8 :]
        return [(name, stamp, data)]

    source = record(tmp_path / "a", "two_anchor_a", 2)
    attached = survey_recording(source).attachments
    if version is not None:
        attached["versions"] = {**attached["versions"], "crawler": version}
    found = analyse(rewrite(source, tmp_path / "b", change, attached))
    assert found.explanation.startswith("equal up to rounding, at most 0 m and ")
    assert "first difference at 1.23 s" in found.explanation
    assert found.healthy == (version is not None)


def test_missing_and_doubled_ticks_are_counted(tmp_path):
    def change(name, stamp, data):
        return [(name, stamp, data)] * {500_000_000: 0, 510_000_000: 0, 600_000_000: 2}.get(stamp, 1)

    source = record(tmp_path / "a", "two_anchor_a", 1)
    path = rewrite(source, tmp_path / "b", change, survey_recording(source).attachments)
    found = analyse(path)
    for topic in ("/joint_states", "/applied_commands"):
        assert found.topics[topic].missing == 2
        assert found.topics[topic].duplicates == 1
    assert found.comparison.duplicates == 1
    assert any("2 tick(s) missing" in p for p in found.problems)
    done = crawler("replay", path)
    assert done.returncode == 1
    assert done.stderr.startswith("crawler: ")
    assert len([line for line in done.stderr.splitlines() if "compiling" not in line]) == 1


def test_a_clock_that_jumps_back_ends_the_simulation_there(tmp_path):
    scene = load_scene("two_anchor_a")
    sent = list(messages(scene, play(scene, 0, 10**9)))
    path = write(tmp_path / "a", [*sent, *[m for m in sent if m[1] >= 500_000_000]], attachments(scene))
    found = analyse(path)
    assert "goes back from 0.99 s to 0.5 s" in found.comparison.stopped
    assert any("decrease without a reset" in p for p in found.problems)


def test_a_reset_is_no_jump(tmp_path):
    scene = load_scene("two_anchor_a")
    sent = list(messages(scene, play(scene, 300_000_000, 2_300_000_000)))
    found = analyse(write(tmp_path / "a", [*sent, *sent], attachments(scene)))
    assert found.problems == ()
    assert found.comparison.identical
    assert found.comparison.resets == 1
    assert len(found.cycles) == 4
    assert [c.run for c in found.cycles] == [0, 0, 1, 1]
    assert found.energy.residual < 1e-12
    assert found.as_plain()["net_translation"] == pytest.approx([4.0, 4.0])
    screen = Screen(width=200, record=True)
    print_replay(found, screen)
    assert "net translation from start to end [m]: 4 (run 0); 4 (run 1)" in screen.export_text()


def test_two_robots_are_told_apart(tmp_path):
    one, two = load_scene("two_anchor_a"), load_scene("two_anchor_b")
    left = [(n, s, d) for n, s, d in messages(one, play(one, 0, 10**9))]
    bag_path = tmp_path / "a"
    writer = BagWriter(bag_path, {})
    for space, sent in (("/left/", left), ("/right/", messages(two, play(two, 0, 2 * 10**9)))):
        channels = {}
        for k, (name, _, data) in enumerate(sent):
            if name not in channels:
                channels[name] = writer.add_topic(read_topics()[name], space + name)
            writer.write(channels[name], 10**18 + k, 10**18 + k, data)
    writer.close()
    with pytest.raises(BagError, match="2 robots; choose one with --namespace /left, /right"):
        analyse(bag_path)
    found = analyse(bag_path, two, "right")
    assert found.comparison.identical
    assert found.comparison.ticks == 201
    with pytest.raises(BagError, match="no crawler in the namespace /middle; there are /left, /right"):
        analyse(bag_path, None, "middle")


def test_a_robot_that_was_noted_under_other_names_is_found_by_those_that_were_recorded(tmp_path):
    scene = load_scene("two_anchor_a")
    noted = {"node": "/left/crawler", "topics": {name: f"/left/{name}" for name in (*STATES, "applied_commands")}}
    path = write(tmp_path / "a", messages(scene, play(scene, 0, NS)), attachments(scene) | noted)
    assert analyse(path).comparison.identical


def test_all_channels_of_a_topic_are_read_where_the_scene_is_unknown(tmp_path):
    scene = load_scene("three_contacts_one_way")
    sent = list(messages(scene, play(scene, 0, 2 * NS)))
    writer = BagWriter(tmp_path / "a", {})
    for begin, part in ((0, sent[: len(sent) // 2]), (len(sent) // 2, sent[len(sent) // 2 :])):
        channels = {name: writer.add_topic(read_topics()[name], f"/{name}") for name in {name for name, *_ in sent}}
        for k, (name, _, data) in enumerate(part, 10**18 + begin):
            writer.write(channels[name], k, k, data)
        writer.flush()
    writer.close()
    found, whole = analyse(tmp_path / "a"), analyse(write(tmp_path / "b", sent, {}))
    assert found.topics["/joint_states"].count == found.table.run.size == 201
    np.testing.assert_array_equal(found.table.net_translation, whole.table.net_translation)


def stopping(length: float, periods: float, rest: float, folder: Path) -> tuple[Rest, ...]:
    """Strategy B from rest, and then nothing for a while."""
    plain = load_scene("two_anchor_b").document()
    plain["drive"]["length"], plain["start"] = length, {"displacement": [0.0, 0.0]}
    scene = Scene.model_validate(plain)
    sent = itertools.chain(play(scene, 0, round(periods * NS)), hold(round(periods * 100), round(rest * 100)))
    return analyse(write(folder, messages(scene, sent), attachments(scene))).rests


def test_a_run_whose_commands_end_says_so(tmp_path):
    (rest,) = stopping(4.0, 2.0, 2.0, tmp_path / "a")
    assert rest.until == pytest.approx(4.0)
    assert rest.since == pytest.approx(2.0)
    assert rest.explain().endswith(" to 4 s: no command changed")


def test_commands_too_weak_to_slide_are_told_with_their_distance(tmp_path):
    """k Lmax < mu: the tension stays L / 2 below what would move a contact, never nearer than 0.1 N."""
    (rest,) = stopping(0.4, 3.0, 0.0, tmp_path / "a")
    assert rest.since == 0.0
    assert rest.margin == pytest.approx(0.1)
    assert "no spring force exceeded its bound (the nearest stayed 0.1 N away)" in rest.explain()


def test_a_run_without_commands_rests_throughout(tmp_path):
    (rest,) = stopping(4.0, 0.0, 1.0, tmp_path / "a")
    assert rest.explain() == "at rest from 0 s to 1 s: no command changed"


def test_a_run_that_moves_to_its_end_did_not_stop(tmp_path):
    assert analyse(record(tmp_path / "a", "two_anchor_a", 2)).rests == ()


def test_what_is_no_crawlers_recording_is_named(tmp_path):

    BagWriter(tmp_path / "empty", {}).close()
    with pytest.raises(BagError, match="the recording has no messages"):
        analyse(tmp_path / "empty")
    scene = load_scene("two_anchor_a")
    poses = [m for m in messages(scene, play(scene, 0, 10**8)) if m[0] == "pose"]
    with pytest.raises(BagError, match=r"no crawler in this recording.*pose \(geometry_msgs"):
        analyse(write(tmp_path / "poses", poses, {}))


@pytest.mark.parametrize("part", [0.3, 0.7, 0.98])
def test_a_torn_file_tells_what_it_can_and_is_recovered(tmp_path, part):
    data = bag.find_file(record(tmp_path / "a", "ten_contact_wave", 3)).read_bytes()
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(data[: int(len(data) * part)])
    told = crawler("replay", torn)
    assert told.returncode == 1
    assert "its end is missing" in told.stderr
    done = crawler("replay", torn, "--recover")
    assert done.returncode == 0, done.stderr
    assert "(recovered from torn.mcap)" in done.stdout
    again = crawler("replay", tmp_path / "torn_recovered", "--json")
    assert json.loads(again.stdout)["complete"] is True
    assert json.loads(again.stdout)["resimulation"]["identical"] is True


@pytest.mark.parametrize("part", [0.0, 0.5])
def test_damage_costs_no_more_than_its_chunk(tmp_path, part):
    """The first chunk defines the channels of all others; the summary at the end repeats them."""
    source = record(tmp_path / "a", "ten_contact_wave", 40)
    whole = survey_recording(source)
    file = bag.find_file(source)
    with file.open("rb") as stream:
        chunks = mcap.reader.make_reader(stream).get_summary().chunk_indexes
    chunk = chunks[int(part * len(chunks))]
    data = bytearray(file.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0x55
    hurt = tmp_path / "hurt.mcap"
    hurt.write_bytes(data)
    found = analyse(hurt)
    assert found.survey.damaged == 1
    assert 0 < found.survey.lost < whole.messages // 2
    assert found.survey.messages + found.survey.lost == whole.messages
    assert found.problems[0].startswith("damaged: 1 chunk(s) cannot be read, ")
    assert found.topics["/joint_states"].last == pytest.approx(40.3)  # what stands behind the damage is read
    assert bag.recover(hurt, tmp_path / "again") == found.survey.messages
    assert survey_recording(tmp_path / "again").complete


def test_of_a_folder_of_recordings_the_newest_is_taken(tmp_path):
    record(tmp_path / "bags" / "b", "two_anchor_b", 1)
    newer = record(tmp_path / "bags" / "a", "two_anchor_a", 1)
    (tmp_path / "bags" / "power_cut.mcap").write_bytes(b"")  # next to the bags: it makes no bag of their folder
    done = crawler("replay", tmp_path / "bags")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"{newer}: complete")
    assert analyse(tmp_path / "bags").path == newer
    assert simulate_again(tmp_path / "bags").identical
    (run,) = read_bag(tmp_path / "bags", load_scene("two_anchor_a"), {})
    assert run.name == newer.name
    assert crawler("animate", tmp_path / "bags", "--out", tmp_path / "x.html").returncode == 0


@pytest.mark.parametrize("verb", [["view", "--png", "x.png"], ["animate", "--out", "x.html"]])
def test_a_recording_without_states_is_one_line_that_names_it(tmp_path, verb):
    path = write(tmp_path / "empty", [], attachments(load_scene("two_anchor_a")))
    done = crawler(verb[0], path, *verb[1:], cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr == f"crawler: {path}: the recording has no state to draw\n"
    assert not list(tmp_path.glob("x.*"))


def test_a_table_without_ramps_has_no_run_that_gained_anything():
    assert RampTable().finish().gained.shape == (0, 1)


def test_a_recordings_own_scene_comes_first(tmp_path):
    """Another scene may be tried on it, but that is said."""
    found = analyse(record(tmp_path / "a", "two_anchor_a", 1), load_scene("two_anchor_b"))
    assert any(p.startswith("--scene is not the scene that the recording holds") for p in found.problems)


@pytest.mark.parametrize("verb", [["replay"], ["view", "--png", "x.png"]])
def test_a_scene_that_this_version_does_not_know_is_one_clear_line(tmp_path, verb):
    scene = load_scene("two_anchor_a")
    attached = attachments(scene)
    attached["scene"] = {**attached["scene"], "wings": 2}
    path = write(tmp_path / "a", messages(scene, play(scene, 0, 10**9)), attached)
    done = crawler(verb[0], path, *verb[1:])
    assert done.returncode == 1
    assert done.stderr.startswith(f"crawler: {path}: invalid scene in the recording: wings: unknown key")
    assert "Traceback" not in done.stderr


def test_show_prints_what_a_recording_holds(tmp_path):
    done = crawler("replay", record(tmp_path / "a", "two_anchor_a", 1), "--show")
    held = yaml.safe_load(done.stdout)
    assert Scene.model_validate(held["scene"]) == load_scene("two_anchor_a")
    assert {"versions", "parameters"} <= set(held)


def test_the_first_time_at_a_bound_is_not_the_least_rounding(tmp_path):
    found = analyse(record(tmp_path / "a", "three_contacts_one_way", 5))
    assert found.margins.least <= 0.0 + 1e-15
    assert found.margins.least_at <= found.slips.start_ns[0] / NS + 0.01


def test_reading_in_blocks_gives_every_message(tmp_path):
    path = record(tmp_path / "a", "three_contacts_two_ways", 3)
    for source in (path, bare(path, tmp_path / "none", compression=mcap.writer.CompressionType.NONE)):
        head = bag.Bag({})
        blocks = [
            (head.channels[c][0].topic, b.data[f : f + s].tobytes())
            for b in bag.read_blocks(source, head)
            for c, f, s in zip(b.channel.tolist(), b.first.tolist(), b.size.tolist(), strict=True)
        ]
        assert blocks == [(r.topic, r.data) for r in bag.read(source)]
        assert head.complete


def pausing(*rows: tuple[float, float]) -> Scene:
    """Two contacts whose link follows a drive once."""
    plain = load_scene("two_contacts_anisotropic").document()
    plain["drive"] = {"times": [time for time, _ in rows], "actuation": [[length] for _, length in rows]}
    return Scene.model_validate(plain)


def play_once(folder: Path, scene: Scene) -> Path:
    last = round(float(scene.drive.times[-1]) * NS)
    return write(folder, messages(scene, play(scene, 0, last)), attachments(scene))


def test_a_rest_in_the_middle_is_told_with_its_reason(tmp_path):
    """The link grows until 1 s, waits until 4 s, and pulls the body together after that."""
    found = analyse(play_once(tmp_path / "a", pausing((0.0, 0.0), (1.0, 1.0), (4.0, 1.0), (5.0, 0.0))))
    assert found.cycles == ()
    (rest,) = found.rests
    assert rest.since == pytest.approx(1.0)
    assert 4.0 < rest.until < 5.0
    assert rest.commanded  # until the tension has turned round
    assert rest.commanded_from == pytest.approx(4.0)
    assert "at rest from 1 s to 4." in rest.explain()
    assert "commands changed from 4 s on, but no spring force exceeded its bound" in rest.explain()
    assert found.as_plain()["rests"] == [rest.as_plain()]


def test_a_recording_without_commands_tells_nothing_about_them(tmp_path):
    bag = play_once(tmp_path / "a", pausing((0.0, 0.0), (1.0, 1.0), (4.0, 1.0), (5.0, 0.0)))

    def keep(*names: str) -> Path:
        def change(name: str, ns: int, data: bytes) -> list:
            return [(name, ns, data)] if name in names else []

        return rewrite(bag, tmp_path / "-".join(names), change, None)

    found = analyse(keep("joint_states", "contact_states"))
    (rest,) = found.rests
    assert rest.as_plain()["commanded"] is None
    with Screen(record=True, width=200) as screen:
        print_replay(found, screen)
    text = screen.export_text()
    assert "cycles: none, as the commands in force were not recorded" in text
    assert "at rest from 1 s to 4.02 s: the commands in force were not recorded" in text
    found = analyse(keep("joint_states"))  # which shows only the first contact
    assert found.rests == ()


def test_a_cycle_ends_with_its_commands_and_not_with_their_tick(tmp_path):
    """A period of 1 s has no whole number of ticks at 7.7 Hz: the last one holds in the rest of its tick."""
    scene = pausing(*((0.5 * k, float(k % 2)) for k in range(9)))
    sent = messages(scene, play(scene, 0, 9 * NS // 2, 7.7), 7.7)
    found = analyse(write(tmp_path / "a", sent, attachments(scene, 7.7)))
    assert [cycle.end for cycle in found.cycles] == pytest.approx([1.0, 2.0, 3.0, 4.0], abs=2e-9)
    assert found.comparison.identical


def test_a_rest_without_commands_says_so(tmp_path):
    scene = pausing((0.0, 0.0), (1.0, 1.0))
    sent = itertools.chain(play(scene, 0, NS), hold(100, 200))
    again = [(start + 3 * NS, dues, [2.0 * row for row in rows]) for start, dues, rows in play(scene, 0, NS)]
    path = write(tmp_path / "a", messages(scene, itertools.chain(sent, again)), attachments(scene))
    (rest,) = analyse(path).rests
    assert (rest.since, rest.run) == (1.0, 0)
    assert rest.until >= 3.0


def test_a_slip_in_a_ramp_of_no_duration_ends_the_rest_before_it(tmp_path):
    """An array and a trajectory in one tick: the length jumps at its start, and then follows the trajectory."""
    scene = load_scene("two_contacts_anisotropic")
    rows = [np.append(length, scene.drive.rows[0, 1:]) for length in (0.3, 0.2)]
    jump = (2 * NS, [0, 10**7], rows)
    sent = messages(scene, itertools.chain(hold(0, 200), [jump]))
    (rest,) = analyse(write(tmp_path / "a", sent, attachments(scene))).rests
    assert (rest.until, rest.commanded) == (2.0, False)
    assert rest.margin > 0.1


def test_rests_within_cycles_are_the_gait_and_not_told(tmp_path):
    assert analyse(record(tmp_path / "a", "three_contacts_two_ways", 3)).rests == ()


def test_without_diagnostics_incidents_are_not_known(tmp_path, capsys):
    found = analyse(record(tmp_path / "a", "two_anchor_a", 1))
    assert found.incidents is None
    assert found.as_plain()["incidents"] is None


def diagnosed(folder: Path, *entries: tuple[str, list[tuple[str, str]]]) -> Path:
    """A recording with one message on /diagnostics."""
    from crawler_ros.wire.messages import encode_diagnostics

    scene = load_scene("two_anchor_a")
    bag_of = BagWriter(folder, attachments(scene))
    channels = {name: bag_of.add_topic(read_topics()[name], name) for name in ("/diagnostics",)}
    statuses = [(0, f"crawler: {part}", "", "", values) for part, values in entries]
    bag_of.write(channels["/diagnostics"], 10**18, 10**18, encode_diagnostics(10**18, statuses))
    sent = messages(scene, play(scene, 0, NS))
    for k, (name, _, data) in enumerate(sent):
        if name not in channels:
            channels[name] = bag_of.add_topic(read_topics()[name], f"/{name}")
        bag_of.write(channels[name], 10**18 + k, 10**18 + k, data)
    bag_of.close()
    return folder


def test_refusals_of_recordings_without_reasons_are_counted_by_topic(tmp_path):
    old = [
        ("refused", "3"),
        ("lost", "1"),
        ("refused on joint_trajectory", "2"),
        ("refused on load_controller/commands", "1"),
    ]
    path = diagnosed(tmp_path / "a", ("simulation", [("ticks", "100"), ("late ticks", "4")]), ("commands", old))
    found = analyse(path).incidents
    assert found is not None
    assert [(r.topic, r.count, r.first) for r in found.refusals] == [
        ("joint_trajectory", 2, None),
        ("load_controller/commands", 1, None),
    ]
    assert found.explain() == [
        "2 message(s) refused on joint_trajectory",
        "1 message(s) refused on load_controller/commands",
        "1 command message(s) lost on the way to the simulator",
        "4 late tick(s)",
    ]


@pytest.mark.parametrize("why", ["nothing would hold the body", "stability would be lost"])
@pytest.mark.parametrize("dropped", ["rows dropped", "dropped because no equilibrium holds their loads"])
@pytest.mark.parametrize("now", [False, True])
def test_refused_ticks_and_dropped_rows_are_told_in_recordings_of_both_versions(why, now, dropped):
    simulation = {"ticks": "100"} if now else {"ticks": "100", f"ticks refused because {why}": "25"}
    parts = {"simulation": simulation, "commands": {dropped: "5", **({"ticks refused": "25"} if now else {})}}
    found = find_incidents({"crawler": parts}, "/")
    assert (found.held, found.dropped) == (25, 5)
    assert found.explain() == [
        "5 command row(s) dropped: no equilibrium holds their loads, or the frictions of a point do not fit together",
        "the commands of 25 tick(s) refused: the body could not follow them",
    ]


def test_rests_and_refusals_are_tables(tmp_path):
    pytest.importorskip("pyarrow")
    from pyarrow import parquet

    reason = ("refused on joint_trajectory: point 3 at 1 s: too late", "2, first at 0.250000000 s, last at 0.5 s")
    simulation = ("simulation", [("ticks", "100")])
    path = diagnosed(tmp_path / "a", simulation, ("commands", [("refused", "2"), reason]))
    assert crawler("replay", path, "--parquet", tmp_path / "tables").returncode == 0
    (row,) = parquet.read_table(tmp_path / "tables" / "refusals.parquet").to_pylist()
    assert row == {
        "topic": "joint_trajectory",
        "why": "point 3 at 1 s: too late",
        "count": 2,
        "first": 0.25,
        "last": 0.5,
    }
    path = play_once(tmp_path / "b", pausing((0.0, 0.0), (1.0, 1.0), (4.0, 1.0), (5.0, 0.0)))
    assert crawler("replay", path, "--parquet", tmp_path / "more").returncode == 0
    (row,) = parquet.read_table(tmp_path / "more" / "rests.parquet").to_pylist()
    assert (row["since"], row["commanded"]) == (1.0, True)


def test_a_recording_in_lock_step_without_ticks_tells_that_no_command_was_accepted(tmp_path):
    scene = load_scene("three_contacts_one_way")
    start = [message for message in messages(scene, []) if message[0] in ("joint_states", "contact_states", "pose")]
    about = attachments(scene)
    about["parameters"] = about["parameters"] | {"lock_step": True}
    done = crawler("replay", write(tmp_path / "a", start, about))
    assert "no tick was run, as no command was accepted" in done.stdout
    assert "was not recorded" not in done.stdout.replace("/diagnostics was not recorded", "")
