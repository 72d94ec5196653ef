"""Analysis of recordings.

`analyse` is the entry point. `recording.decode` and `health` decode bytes to arrays; states come from the model
(`resimulate`, `midrun`) or, where no scene is known, from the recorded states (`observe`); `ramps` passes every ramp to
`cycles`, `slips`, `cycle_table` and `margins`; `show` prints, tabulates, draws and compares the results.
"""

from .analysis import Replay, analyse, simulate_again

__all__ = ["Replay", "analyse", "simulate_again"]
