"""Compute where a body can rest and in which direction each side of its stasis domain lets it move; draw the domain.

Run it with `python examples/stasis_domain.py`; it writes stasis_domain.png.

Look for: with backward friction 1.5 times the forward one the domain is a hexagon, whose sides go forward and backward
in turn; with 2.5 times it is a triangle, and no command moves the body back. Inside, a margin is the additional force
that each contact can bear; at 0 the contact slides.
"""

from pathlib import Path

import numpy as np

from crawler_model import load_scene
from crawler_model.theory.stasis import StasisDomain
from crawler_model.theory.uniqueness import uniqueness_margin
from crawler_pictures.domain import draw_domain

forward = np.full(3, 0.2)  # N, one value per contact
domains = {ratio: StasisDomain(forward, ratio * forward) for ratio in (1.5, 2.5)}

for ratio, domain in domains.items():
    print(f"backward friction {ratio} times the forward one:")
    print(f"  corners (T_0, T_1) [N]: {domain.vertices().round(9).tolist()}")
    for facet in domain.facets():
        way = "forward" if facet.direction > 0 else "backward"
        print(f"  side with normal {facet.normal.tolist()}: contact {facet.contact} slides {way}")
    print(f"  one way only: {domain.one_way}")
    print(f"  distance from a balance of friction: {uniqueness_margin(domain.forward, domain.backward):.4f}")

tension = np.array([0.1, -0.1])  # link 0 stretched, link 1 compressed
margins = domains[1.5].margins(tension)
print(f"at T = {tension.tolist()} N: at rest {domains[1.5].contains(tension)}, margins {margins.round(9).tolist()} N")

scene = load_scene("three_contacts_two_ways")  # its own friction, and the path of its run
draw_domain(scene, Path("stasis_domain.png"))
