"""Results as tables of libraries that are imported only when they are asked for."""

from __future__ import annotations

import importlib
from typing import Any

from ..errors import CrawlerError


class Tabular:
    """Results with a method `to_table`."""

    def to_pandas(self) -> Any:
        """Convert to a data frame of pandas, with the columns of `to_table`.

        Returns:
            A pandas.DataFrame.

        Raises:
            CrawlerError: if pyarrow or pandas is not installed.
        """
        load_library("pandas", "to_pandas")
        return self._table("to_pandas").to_pandas()

    def to_polars(self) -> Any:
        """Convert to a data frame of polars, with the columns of `to_table`.

        Returns:
            A polars.DataFrame.

        Raises:
            CrawlerError: if pyarrow or polars is not installed.
        """
        polars = load_library("polars", "to_polars")
        return polars.from_arrow(self._table("to_polars"))

    def _table(self, call: str) -> Any:
        load_library("pyarrow", call)
        return self.to_table()  # type: ignore[attr-defined]


def load_library(name: str, call: str) -> Any:
    """Import a library of the extra `tables`.

    Args:
        name: the library.
        call: what needs it, for the error message.

    Returns:
        The module.

    Raises:
        CrawlerError: if it is not installed; the message contains the command that installs it.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError:
        raise CrawlerError(f"{call}: {name} is not installed; pip install 'crawler-ros[tables]'") from None
