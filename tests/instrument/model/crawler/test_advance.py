"""A usual command, which one compiled call checks and follows, beside the same command checked and followed apart."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import CommandError, Crawler, load_scene


@pytest.mark.parametrize("method", ["exact", "catch_up"])
@pytest.mark.parametrize("name", ["ten_contact_wave", "three_springs", "silicone_chain"])
def test_a_usual_command_leads_where_its_target_leads_to_the_bit(name, method):
    scene = load_scene(name)
    at_once, apart = Crawler(scene, method), Crawler(scene, method)
    lengths = scene.drive.rows[:12, : scene.body.springs]
    steps = []
    for row in lengths:
        steps.append((at_once.advance(row.tolist()), apart.follow(apart.target(row)[None])))
        assert at_once == apart
        assert at_once.row.tobytes() == apart.row.tobytes()
    for ours, theirs in steps:  # later commands do not change an account
        assert ours.velocity.tobytes() == theirs.velocity.tobytes()
        assert ours.account.tobytes() == theirs.account.tobytes()
        assert ours.translation_interval == theirs.translation_interval
        assert not (ours.velocity.flags.writeable)
        assert not (ours.account.flags.writeable)
    assert any(ours.work != 0.0 for ours, _ in steps)


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ([0.1, np.nan], "entry 1 is nan; it must be finite"),
        ([-np.inf, 0.1], "entry 0 is -inf; it must be finite"),
        ([0.1, -1.1e100], r"entry 1 is -1\.1e\+100; it must be at most 1e\+100 in size"),
        ([0.1], r"shape \(1,\); it must be \(2,\)"),
        ([0.1, [0.2]], "it must be 2 numbers"),
        (["a", "b"], "it must be 2 numbers"),
    ],
)
def test_a_command_that_is_refused_changes_nothing(command, told):
    crawler = Crawler(load_scene("three_contacts_one_way"))
    crawler.advance([0.1, 0.0])
    before = crawler.copy()
    with pytest.raises(CommandError, match=f"^actuation: .*{told}"):
        crawler.advance(command)
    assert crawler == before
    assert crawler.advance([0.1, -1e100]).account[0] != 0.0  # the largest length is none too large


def test_commands_of_any_kind_of_numbers_are_equal():
    ours = [Crawler(load_scene("three_contacts_one_way")) for _ in range(4)]
    strided = np.array([[0.25, 9.0], [0.5, 9.0]])[:, 0]
    fixed = np.array([0.25, 0.5])
    fixed.flags.writeable = False
    for crawler, command in zip(ours, ([0.25, 0.5], strided, fixed, np.float32([0.25, 0.5])), strict=True):
        crawler.advance(command)
        assert crawler == ours[0]


@pytest.mark.parametrize("name", ["ten_contact_wave", "planar_rectilinear", "steering_inchworm"])
def test_arrays_of_another_shape_are_refused_before_a_kernel_reads_beyond_them(name):
    crawler = Crawler(load_scene(name))
    targets = crawler.scene.drive.targets
    count, width = targets.shape
    records = np.zeros((count, 2 * crawler.displacement.size + crawler.tension.size))
    before = crawler.copy()
    for call in (
        lambda: crawler.follow(targets[:, :-1]),
        lambda: crawler.lengths_at(targets[:, :-1]),
        lambda: crawler.placed(crawler.displacement, targets[0, :-1]),
    ):
        with pytest.raises(CommandError, match=rf"^targets: shape \(.*\(V, {width}\) is right"):
            call()
    with pytest.raises(CommandError, match=r"^targets: shape \("):
        crawler.follow(targets[0])
    for wrong in (records[:-1], records[:, :-1], records.astype(np.float32)):
        with pytest.raises(CommandError, match=r"^records: float\d\d, shape \("):
            crawler.follow(targets, wrong)
    with pytest.raises(CommandError, match=r"^displacement: shape \("):
        crawler.placed(crawler.displacement[:-1], targets[0])
    assert crawler == before
    crawler.follow(targets, records)
    assert (records[-1, : crawler.displacement.size] == crawler.displacement.ravel()).all()
