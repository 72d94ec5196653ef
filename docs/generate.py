"""Generate what is derived from the code: the JSON schema of scene files."""

from __future__ import annotations

import json
from pathlib import Path

from crawler_model import Scene

SCHEMA = Path(__file__).parent.parent / "msgs_config" / "scene.schema.json"


def schema() -> str:
    """Return the scene schema as the file has it."""
    return json.dumps(Scene.model_json_schema(), indent=2) + "\n"


if __name__ == "__main__":
    SCHEMA.write_text(schema(), encoding="utf-8")
    print(f"written: {SCHEMA.relative_to(SCHEMA.parent.parent)}")
