"""Springs that remember: Maxwell-slip elements parallel to a bent spring, each a spring in series with a slider.

The force of an element is h = k (z - slip), |h| <= limit. Where h is at its limit the element yields: h rests, and the
slip follows z. When z turns round it is elastic at once. To its bent spring an element is a piece of the curve of the
passive spring that moves while it yields: between its turns it is a line, and a turn is a knot.
"""

from __future__ import annotations

from ....compiled import inlined, lean

TURN = 3
"""The first turn among the knots in `coming` of a BEND; turns of the other sliders of the spring follow."""


@lean
def line_of_sliders(sliders, bend):
    """Find the line that the forces of all sliders of a bent spring are on.

    Returns:
        Its slope [N/m], and its force at z = 0 [N].
    """
    slope = force = 0.0
    for k in range(bend.first, bend.last):
        slider = sliders[k]
        if slider.mode == 0:
            slope += slider.stiffness
            force -= slider.stiffness * slider.slip
        else:
            force += slider.mode * slider.limit
    return slope, force


@inlined
def _force_of(slider, z):
    """Compute the force of a slider at an elongation."""
    return slider.stiffness * (z - slider.slip) if slider.mode == 0 else slider.mode * slider.limit


@lean
def force_of_sliders(sliders, bend, z):
    """Sum the forces of all sliders of a bent spring at an elongation [m].

    Returns:
        The sum [N].
    """
    force = 0.0
    for k in range(bend.first, bend.last):
        force += _force_of(sliders[k], z)
    return force


@lean
def energy_of_sliders(sliders, bend, z):
    """Compute the energy stored in all sliders of a bent spring at an elongation [m].

    Returns:
        The energy [J].
    """
    energy = 0.0
    for k in range(bend.first, bend.last):
        force = _force_of(sliders[k], z)
        energy += 0.5 * force * force / sliders[k].stiffness
    return energy


@lean
def energy_remembered(springs, bends, sliders):
    """Compute the energy stored in all sliders of a body at the end of a ramp.

    Args:
        bends: BEND, shape (B,).

    Returns:
        The energy [J].
    """
    energy = 0.0
    for j in range(springs.shape[0]):
        if springs[j].bend >= 0:
            energy += energy_of_sliders(sliders, bends[springs[j].bend], springs[j].elongation)
    return energy


@lean
def find_turn(sliders, bend, z, stretch, soonest):
    """Find whether a slider begins or ceases to yield before another knot of its spring.

    Args:
        stretch: rate of z [m].
        soonest: how long it takes to that knot.

    Returns:
        How long it takes to the first of both; the number of the slider, -1 if it is none.
    """
    found = -1
    if stretch == 0.0:
        return soonest, found
    direction = 1 if stretch > 0.0 else -1
    for k in range(bend.first, bend.last):
        slider = sliders[k]
        if slider.mode == direction:
            continue
        when = 0.0
        if slider.mode == 0:
            when = max((direction * slider.reach - (z - slider.slip)) / stretch, 0.0)
        if when < soonest:
            soonest, found = when, k - bend.first
    return soonest, found


@inlined
def _settle(slider, bend, ramp, z):
    """Let the slip of a slider that yields follow z, and account for its dissipation."""
    slip = z - slider.mode * slider.reach
    if slip != slider.slip:
        # a slip is a difference of rounded lengths, and may be a hair against the force
        ramp.account.internal += max(slider.mode * slider.limit * (slip - slider.slip), 0.0)
        slider.slip = slip
        bend.slipped = 1


@lean
def turn_slider(sliders, bend, ramp, z, number):
    """Let a slider begin to yield, or cease to.

    Args:
        number: of the slider in its spring.
    """
    slider = sliders[bend.first + number]
    if slider.mode != 0:
        _settle(slider, bend, ramp, z)
        slider.mode = 0
    else:
        slider.mode = 1 if z > slider.slip else -1


@lean
def settle_sliders(sliders, bend, ramp, z):
    """Let the slips of a bent spring follow its elongation where a ramp or a part of it ends."""
    for k in range(bend.first, bend.last):
        if sliders[k].mode != 0:
            _settle(sliders[k], bend, ramp, z)


@lean
def change_sliders(sliders, bend, z, near):
    """Find which sliders of a bent spring yield at the end of an implicit step that has been solved.

    Args:
        near: rounding of z, the elongation there [m].

    Returns:
        Whether that has changed, so that the step has to be solved anew.
    """
    changed = False
    for k in range(bend.first, bend.last):
        slider = sliders[k]
        way, mode = z - slider.slip, slider.mode
        if mode == 0 and abs(way) > slider.reach + near:
            slider.mode = 1 if way > 0.0 else -1
        elif mode != 0 and mode * way < slider.reach - near:
            slider.mode = 0  # if it yields in the other direction, that is found from here
        changed = changed or slider.mode != mode
    return changed


@lean
def keep_sliders(sliders):
    """Keep which sliders yield in the last part of an implicit step that has been solved."""
    for k in range(sliders.shape[0]):
        sliders[k].kept = sliders[k].mode


@lean
def return_sliders(sliders, bend):
    """Let the sliders of a bent spring yield as in `keep_sliders`.

    Returns:
        Whether any did otherwise.
    """
    changed = False
    for k in range(bend.first, bend.last):
        slider = sliders[k]
        changed = changed or slider.mode != slider.kept
        slider.mode = slider.kept
    return changed
