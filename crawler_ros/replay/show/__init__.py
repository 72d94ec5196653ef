"""How a replay is shown: text, tables, pages, comparisons."""
