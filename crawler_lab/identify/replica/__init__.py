"""The model under recorded commands, with its derivatives.

Functions name their arguments alike; a docstring lists only what it adds to this:

Args:
    scene: the scene.
    body: its body.
    derivatives: of its arrays.
    measured: the recording, checked.
    keys: names of single parameters.
    values: of the parameters, shape (P,).
    lag: the recording shows the state of this long ago [s].
    gain: error of the gain of the actuators [1].
    with_gain: whether there is a column of derivatives with respect to the gain, after the columns of the parameters.
    start: numbers of an unknown start, as in `start.py`, shape (S,) [m]; None for the start of the scene.
    time: shape (T,) [s].
    x: displacement, shape (T, N) [m].
    recorded: whether the drive is recorded commands, whose times do not depend on parameters.
"""
