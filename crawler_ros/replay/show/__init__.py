"""Presentation of a replay: text, tables, pages, comparisons."""
