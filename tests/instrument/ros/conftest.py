from collections.abc import Iterator
from pathlib import Path

import pytest

from .graph import Graph, graph


@pytest.fixture
def ros(tmp_path: Path) -> Iterator[Graph]:
    with graph(tmp_path) as made:
        yield made
