"""From a recording to knowledge.

`analyse` is the door. Bytes become arrays in `layouts` and `health`; states come from the model (`resimulate`,
`midrun`) or, where no scene is known, from what was recorded (`observe`); every ramp goes through `ramps` to `cycles`,
`slips`, `cycle_table` and `margins`; `report`, `tables`, `page` and `compare` show what was found.
"""

from .analysis import Replay, analyse, simulate_again

__all__ = ["Replay", "analyse", "simulate_again"]
