"""Gaits as tables, and their numbers by name and time."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from crawler_lab.optimise.gait_table import describe_gait, format_gait, name_number, tabulate_gait
from crawler_model import load_scene

from ...commands import crawler


@pytest.mark.parametrize("name", ["two_anchor_a", "worm_in_a_tube", "planar_rectilinear", "scissors", "hybrid_body"])
def test_a_table_has_every_command_that_moves_at_every_waypoint(name):
    scene = load_scene(name)
    heads, rows = tabulate_gait(scene)
    drive, columns = scene.drive, scene.columns
    shown = [columns.names.index(head.split(" [")[0]) for head in heads[1:]]
    assert np.array_equal(np.array(rows)[:, 0], drive.times)
    assert np.array_equal(np.array(rows)[:, 1:], drive.rows[:, shown])
    assert set(np.flatnonzero(np.ptp(drive.rows, axis=0))) <= set(shown)
    _, *cells = csv.reader(format_gait(scene, ".csv").splitlines())
    assert [[float(cell) for cell in row] for row in cells] == rows
    markdown = format_gait(scene, ".md").splitlines()
    assert len(markdown) == len(rows) + 2
    assert len({line.count("|") for line in markdown}) == 1
    assert len({len(line) for line in describe_gait(scene, 5)[:6]}) == 1


@pytest.mark.parametrize(
    ("scene", "key", "name"),
    [
        ("two_anchor_a", "drive.actuation[1][0]", "length of link_0 at 0.25 s"),
        ("planar_rectilinear", "drive.actuation[1][0][1]", "length of link_0/y at"),
        ("two_anchor_a", "friction.isotropic", "friction.isotropic"),
        ("two_anchor_a", "drive.friction.isotropic[1][1]", "friction of contact_1 at 0.25 s"),
    ],
)
def test_a_number_of_a_gait_is_named_by_what_it_commands(scene, key, name):
    assert name_number(load_scene(scene), key).startswith(name)


def test_a_search_prints_and_writes_the_gait_by_name_and_time(tmp_path):
    words = ("optimise", "two_contacts_anisotropic", "--for", "translation", "--stroke", "0:0.1", "--waypoints", "2")
    done = crawler(*words, "--table", "gait.md", "--out", "gait.yaml", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "gait.md").read_text() == format_gait(load_scene(str(tmp_path / "gait.yaml")), ".md")
    assert "time [s]  link_0 [m]" in done.stdout
    assert "drive.actuation" not in done.stdout
    wrong = crawler(*words, "--table", "gait.txt", cwd=tmp_path)
    assert "--table: gait.txt must end in .csv or .md" in wrong.stderr
