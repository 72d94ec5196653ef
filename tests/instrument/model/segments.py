"""Segments, what is known of homogeneous ones in closed form, and random bodies on them."""

from __future__ import annotations

import numpy as np

from crawler_model import Scene, simulate


def segment(strokes, accuracy=None, elements=None, **given):
    """A homogeneous segment that lengthens and shortens evenly."""
    part = {"name": "trunk", "from": 0.0, "to": 1.0, "stiffness": 1.0, "friction": {"forward": 0.1, "backward": 0.3}}
    part |= {"accuracy": accuracy, "elements": elements} | given
    drive = {"times": [0, 0.5, 1], "period": 1, "actuation": [[0], [strokes], [0]]}
    return Scene.model_validate({"name": "segment", "body": {"segments": [part]}, "drive": drive})


def closed_form(length, modulus, forward, backward, stroke):
    """Net translation per period after the first, [G] section 3.3."""
    weaker, stronger = min(forward, backward), max(forward, backward)
    gained = length * max(0.0, stroke - weaker * length / modulus) * (stronger - weaker) / (stronger + weaker)
    return gained if forward < backward else -gained


def unequal(seed):
    """A random body on a segment with friction up to a thousand times stronger one way, and an accuracy."""
    rng = np.random.default_rng([2026, seed])
    kind = ("homogeneous", "table", "hybrid", "once", "waves")[seed % 5]
    length, modulus = float(10 ** rng.uniform(-2, 1)), float(10 ** rng.uniform(-1, 3))
    weak = modulus / length * float(10 ** rng.uniform(-2, 0.5))
    sides = [weak, weak * float(10 ** rng.uniform(0, 3))]
    rng.shuffle(sides)
    stroke = float(rng.uniform(1.2, 6.0)) * weak * length / modulus

    def table(middle):
        at = np.sort(rng.uniform(0.0, length, 4))
        return {"at": at.tolist(), "value": (middle * 4 ** rng.uniform(-1, 1, 4)).tolist()}

    part = {"name": "trunk", "from": 0.0, "to": length, "stiffness": modulus}
    part["friction"] = dict(zip(("forward", "backward"), sides, strict=True))
    document = {"name": kind, "body": {"segments": [part]}}
    rows = [[0.0], [stroke], *([float(v)] for v in stroke * rng.uniform(0, 1, 2)), [0.0]]
    if kind == "table":
        part["stiffness"] = table(modulus)
        part["friction"] = {side: table(value) for side, value in part["friction"].items()}
    if kind == "hybrid":
        document["body"] |= {"contacts": [1.4 * length], "links": {"stiffness": modulus / length}}
        foot = length * weak * float(10 ** rng.uniform(-1, 1))
        document["friction"] = {"forward": foot, "backward": foot * float(rng.uniform(0.1, 10))}
        rows = [
            [float(v) * length, *row] for v, row in zip((0, *rng.uniform(-stroke, stroke, 3), 0), rows, strict=True)
        ]
    document["drive"] = {"times": [0, 0.3, 0.5, 0.7, 1], "actuation": rows} | ({} if kind == "once" else {"period": 1})
    if kind == "waves":
        waves = {"amplitude": stroke, "wavelength": length / float(rng.uniform(0.3, 4)), "period": 1.0, "samples": 16}
        friction = waves | {"amplitude": 0.8 * weak, "mean": weak, "wavelength": length / float(rng.uniform(1, 5))}
        document |= {"drive": {"wave": waves, "friction_wave": friction}, "start": "relaxed"}
    return document, float(10 ** rng.uniform(-3.2, -1))


def gains(document, **cut):
    (part,) = document["body"]["segments"]
    scene = Scene.model_validate(document | {"body": document["body"] | {"segments": [part | cut]}})
    if scene.drive.period is None:
        return scene, simulate(scene, rate=1.0).waypoint_net_translation
    return scene, simulate(scene, duration=3.0, rate=1.0).per_period


def accuracies(length, modulus, forward, backward, stroke, accuracy, method="exact"):
    """The error of the net translation per period of a homogeneous segment, in units of the accuracy asked for."""
    friction = {"forward": forward, "backward": backward}
    scene = segment(stroke, accuracy=accuracy, to=length, stiffness=modulus, friction=friction)
    gained = simulate(scene, duration=3.0, rate=1.0, method=method).per_period[1:]
    exact = closed_form(length, modulus, forward, backward, stroke)
    return float(np.abs(gained - exact).max() / (accuracy * length * stroke))


def random_homogeneous(seed):
    """Length, modulus, both frictions, one up to a thousand times the other, stroke, and an accuracy."""
    rng = np.random.default_rng([77, seed])
    length, modulus = 10 ** rng.uniform(-3, 1), 10 ** rng.uniform(-2, 5)
    weak = modulus / length * 10 ** rng.uniform(-4, 0.5)
    sides = [weak, weak * 10 ** rng.uniform(0, 3)]
    rng.shuffle(sides)
    stroke = weak * length / modulus * 10 ** rng.uniform(-0.3, 2)
    return (*(float(v) for v in (length, modulus, *sides, stroke)), float(10 ** rng.uniform(-3.3, -0.7)))


VARIOUS = ("weak", "isotropic", "untouched", "chambers", "slope", "commanded", "tendon", "one_way", "shortening")


def various(seed):
    """A random body on segments whose transient, uniqueness or looks matter, and an accuracy."""
    rng = np.random.default_rng([63, seed])
    kind = VARIOUS[seed % len(VARIOUS)]
    weak = float(rng.uniform(0.05, 0.2))
    sides = [weak, weak * float(rng.uniform(1.2, 6.0))]
    rng.shuffle(sides)
    part = {"name": "trunk", "from": 0.0, "to": 1.0, "stiffness": float(rng.uniform(0.5, 2.0))}
    part["friction"] = dict(zip(("forward", "backward"), sides, strict=True))
    stroke = float(rng.uniform(1.2, 4.0)) * weak
    rows = [[0.0], [stroke], [float(rng.uniform(-0.3, 1)) * stroke], [float(rng.uniform(-0.3, 1)) * stroke], [0.0]]
    drive = {"times": [0, 0.3, 0.5, 0.7, 1], "period": 1, "actuation": rows}
    document = {"name": kind, "body": {"segments": [part]}, "drive": drive}
    if kind == "weak":
        drive["actuation"] = [[v * 0.3] for (v,) in rows]
    if kind == "isotropic":
        part["friction"] = {"isotropic": weak}
    if kind == "untouched":
        at = np.sort(rng.uniform(0.2, 0.8, 2))
        at = [0.0, at[0], at[0] + 0.01, at[1] + 0.02, at[1] + 0.03, 1.0]
        part["friction"] = {"isotropic": {"at": [float(v) for v in at], "value": [weak, weak, 0, 0, weak, weak]}}
    if kind == "chambers":
        count = int(rng.integers(2, 5))
        document["body"] = {
            "segments": [part | {"name": f"chamber{i}", "from": 1.5 * i, "to": 1.5 * i + 1.0} for i in range(count)],
            "links": {"stiffness": float(rng.uniform(1.0, 5.0))},
        }
        given = rng.uniform(-0.3, 1, (4, count)) * stroke
        given[0] = 0.0
        drive["actuation"] = [[0.0] * (count - 1) + row for row in (*given.tolist(), given[0].tolist())]
    if kind == "slope":
        document["body"]["weights"] = weak
        document |= {"ground": {"slope": float(rng.uniform(-20, 20))}, "start": "relaxed"}
    if kind == "commanded":
        drive["friction"] = {s: [[v * float(f)] for f in rng.uniform(0.5, 2, 4)] for s, v in part["friction"].items()}
        for column in drive["friction"].values():
            column.append(column[0])
    if kind == "tendon":
        part["tension"] = {"least": 0.0, "most": float(rng.uniform(0.05, 0.5))}
    if kind == "one_way":
        part["friction"][str(rng.choice(["forward", "backward"]))] = 0.0
    if kind == "shortening":
        drive["actuation"] = [[-v] for (v,) in rows]
    return document, float(10 ** rng.uniform(-3, -1))
