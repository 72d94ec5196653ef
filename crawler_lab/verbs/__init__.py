"""The verbs of the laboratory, which `pyproject.toml` enters in the command `crawler`."""
