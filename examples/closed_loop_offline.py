"""Walk over rougher and rougher ground, open loop and with feedback, without ROS.

Run it with `python examples/closed_loop_offline.py`.

Look for: in open loop, each stride loses to the spring what the ground takes (4 m less the roughness in m, once the
gait has settled). The controller measures the length of the body, corrects the command until that length is right, and
gains 3 m per stride everywhere. It needs to know neither friction nor stiffness.
"""

from crawler_model import Crawler, Scene

TWO_FEET = {
    "name": "two_feet",
    "body": {"contacts": [0.0, 1.0], "links": {"stiffness": 1.0}},  # m, N/m
    "friction": {"isotropic": 1.0},  # N; the strides below command their own
}
HELD, LIFTED = 1.5, 0.5  # N per roughness
GROUND = [0.5] * 3 + [1.0] * 3 + [2.0] * 3  # roughness under each stride


def open_loop(crawler, length):
    """Command the rest length that is right for 0.5 N on the lifted foot."""
    crawler.advance([length])


def feedback(crawler, length):
    """Correct the command by the missing length until the body has the right length."""
    command = crawler.actuation[0]
    while abs(missing := length - crawler.shape[0]) > 1e-9:
        command += missing
        crawler.advance([command])


def walk(move, short, long):
    """Take a stride on each piece of ground; return the gain of each, m."""
    crawler = Crawler(Scene.model_validate(TWO_FEET))
    gains = []
    for rough in GROUND:
        before = crawler.net_translation
        for grip, length in (([HELD, LIFTED], long), ([LIFTED, HELD], short)):
            friction = [rough * part for part in grip]
            crawler.advance(crawler.actuation, friction, friction)  # first the grip, then the stroke
            move(crawler, length)
        gains.append(crawler.net_translation - before)
    return gains


without = walk(open_loop, short=0.0, long=4.0)
with_feedback = walk(feedback, short=0.0, long=3.0)
print("roughness  open loop, m  feedback, m")
for rough, one, other in zip(GROUND, without, with_feedback, strict=True):
    print(f"{rough:9.1f} {one:13.6f} {other:12.6f}")
