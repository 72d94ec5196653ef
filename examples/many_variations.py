"""Run a scene with 3249 pairs of frictions and compare each result with the closed form.

Run it with `python examples/many_variations.py`.

Look for: the body moves towards the lower friction, by the stroke less twice that friction over the stiffness; where
both are equal it does not move, and the run reports that its translation is not unique.
"""

import numpy as np

from crawler_lab import simulate_many, vary
from crawler_model import load_scene

scene = load_scene("two_contacts_anisotropic")  # strokes of 0.1 m, stiffness 20 N/m
friction = np.linspace(0.05, 0.75, 57)  # N
variations = vary(scene, {"friction.forward": friction, "friction.backward": friction})  # every combination
runs = simulate_many(variations)
print(runs)

gain = runs.per_period.reshape(variations.shape)  # a row per forward, a column per backward friction
forward, backward = np.meshgrid(friction, friction, indexing="ij")
closed_form = np.sign(backward - forward) * np.maximum(0.1 - 2.0 * np.minimum(forward, backward) / 20.0, 0.0)
print(f"largest distance from the closed form: {np.abs(gain - closed_form).max():.0e} m")

unique = runs.unique.reshape(variations.shape)
print(f"not unique: {np.count_nonzero(~unique)} of {len(runs)}, all of equal friction: {(~unique <= np.eye(57)).all()}")

print("\nm per period; down: forward friction, across: backward friction, N")
few = slice(None, None, 8)
print("      " + " ".join(f"{mu:6.2f}" for mu in friction[few]))
for mu, row in zip(friction[few], gain[few, few] + 0.0, strict=True):
    print(f"{mu:5.2f} " + " ".join(f"{value:6.3f}" for value in row.round(9) + 0.0))
