"""Tables, pages and .rrd files of replays."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from crawler_pictures.colors import FORWARD, TENSION, rgb
from crawler_ros.replay import analyse

from ...commands import crawler
from ...recordings import record

parquet = pytest.importorskip("pyarrow.parquet")


@pytest.mark.parametrize("name", ["two_anchor_b", "planar_rectilinear"])
def test_tables_pages_and_rrd(tmp_path, name):
    path = record(tmp_path / "a", name, 2)
    words = ("--parquet", tmp_path / "t", "--png", tmp_path / "x.png", "--rrd", tmp_path / "x.rrd")
    done = crawler("replay", path, *words)
    assert done.returncode == 0, done.stderr
    found = analyse(path)
    tables = {
        name: parquet.read_table(tmp_path / "t" / f"{name}.parquet")
        for name in ("ticks", "contacts", "links", "slips", "cycles")
    }
    for table in tables.values():
        assert all(b"unit" in field.metadata for field in table.schema)
    ticks = tables["ticks"].num_rows
    assert ticks == found.comparison.ticks
    assert tables["contacts"].num_rows == ticks * len(found.contacts)
    assert tables["slips"].num_rows == found.slips.contact.size
    assert tables["cycles"].num_rows == len(found.cycles) == 2
    assert np.nansum(tables["ticks"]["work"].to_numpy()) == pytest.approx(found.energy.work)
    assert (tmp_path / "x.rrd").stat().st_size > 10_000
    pixels = np.asarray(Image.open(tmp_path / "x.png").convert("RGB")).astype(int)
    assert pixels.shape[1] > 1000
    for color in (rgb(FORWARD), rgb(TENSION)):
        assert (np.abs(pixels - color).max(axis=2) < 12).sum() > 200


def test_a_table_folder_is_not_overwritten(tmp_path):
    path = record(tmp_path / "a", "two_anchor_b", 1)
    (tmp_path / "t").mkdir()
    (tmp_path / "t" / "x").write_text("mine")
    assert "choose a new folder" in crawler("replay", path, "--parquet", tmp_path / "t").stderr
