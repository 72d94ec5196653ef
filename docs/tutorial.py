"""Draw the figures of docs/tutorial.md into docs/pictures/tutorial, or into another folder."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.colors import ListedColormap

from crawler_lab import simulate_many, vary
from crawler_model import Crawler, Scene, load_scene, simulate
from crawler_model.theory.stasis import StasisDomain
from crawler_pictures.body import draw_body, draw_length
from crawler_pictures.colors import ACTUATION, BACK, CONTACTS, FORWARD
from crawler_pictures.domain_many import draw_box_in_space, draw_polygon
from crawler_pictures.domain_text import STYLE, friction_at
from crawler_pictures.domain_two import draw_band, draw_box, draw_motion, draw_sweeping

PICTURES = Path(__file__).parent / "pictures" / "tutorial"


def run(folder: Path) -> dict[str, Any]:
    """Draw all figures, section by section of the page.

    Args:
        folder: where the figures are written.

    Returns:
        The names that are defined at the end.
    """
    with _working_in(folder):
        plt.rcParams.update(STYLE)

        # 1. A body and its links
        scene = load_scene("three_contacts_two_ways")
        run = simulate(scene, duration=3.0)
        instants = (2.0, 2.25, 2.75, 3.0)  # of the third period, s
        figure, axes = plt.subplots(4, 1, figsize=(8, 6), sharex=True, layout="constrained")
        for axis, time in zip(axes, instants, strict=True):
            row = round(time * run.rate)
            place = scene.body.position + run.displacement[row]
            actuation = [np.interp(time % 1.0, scene.drive.times, column) for column in scene.drive.actuation.T]
            draw_body(axis, scene, run.displacement[row], actuation, actuators=[1])
            rest, actuator = 0.15 + actuation[0], 0.075 + actuation[1]
            draw_length(axis, place[0], place[0] + rest, 1.95, f"$L^{{rest}}_0$ = {rest:.3f} m")
            draw_length(axis, place[1], place[1] + actuator, 1.3, f"$L^{{act}}_1$ = {actuator:.3f} m")
            first, second = run.tension[row].round(9) + 0.0  # no -0
            axis.set_title(f"t = {time:g} s:  $T_0$ = {first:.1f} N,  $T_1$ = {second:.1f} N", loc="left")
            for foot in scene.body.position + run.displacement[200]:
                axis.axvline(foot, color="#b0b0b0", linewidth=0.8, linestyle=":", zorder=0)
        axes[-1].set_xlabel("along the ground [m]; dotted: where the contacts stood at t = 2 s")
        figure.savefig("body.png", dpi=100)

        # 2. Two contacts: the box and its section
        pairs = {
            r"$2 \mu_- = \mu_+$": StasisDomain([2.0, 2.0], [1.0, 1.0]),
            r"$\mu_- = \mu_+$": StasisDomain([1.5, 1.5], [1.5, 1.5]),
        }
        figure, axes = plt.subplots(1, 2, figsize=(8, 4.2), layout="constrained")
        for axis, (name, domain) in zip(axes, pairs.items(), strict=True):
            draw_box(axis, domain, reach=2.0)
            axis.set(title=name, xlabel="$(g_0 + g_1)/2$ [N]", ylabel="$T = (g_0 - g_1)/2$ [N]")
        figure.savefig("two_contacts.png", dpi=100)

        # 3. Two contacts: a triangle wave
        two_contacts = {
            "name": "two_contacts",
            "body": {"contacts": [0.0, 20.0], "links": {"stiffness": 1.0}},
            "friction": {"forward": 4.0, "backward": 2.0},
            "drive": {"times": [0.0, 16.0, 32.0], "period": 32.0, "actuation": [[0.0], [16.0], [0.0]]},
        }
        two = simulate(Scene.model_validate(two_contacts), duration=64.0, rate=1.0)
        letters = dict(zip("abcdefghi", (0, 2, 9, 16, 20, 26, 32, 36, 43), strict=True))  # s; one tick is one second
        figure, (above, below) = plt.subplots(2, 1, figsize=(9, 8.4), height_ratios=(1.5, 1), layout="constrained")
        draw_sweeping(above, two, list(letters.values()))
        draw_motion(below, two)
        for letter, time in letters.items():
            below.axvline(time, color="black", linewidth=0.8, linestyle=":")
            below.text(time, 1.02, letter, transform=below.get_xaxis_transform(), ha="center")
        below.set(xlabel="time [s]", xlim=(0.0, 64.0))
        figure.savefig("triangle_wave.png", dpi=100)

        # 4. Two equal frictions: not unique
        critical = Crawler(Scene.model_validate(two_contacts | {"friction": {"isotropic": 1.0}}))
        critical.advance([1.0])  # T = -mu: the greatest compression
        lengths = np.linspace(1.0, 5.0, 41)
        steps = [critical.copy().advance([length]) for length in lengths]
        interval = np.array([step.translation_interval for step in steps])
        chosen = np.array([step.velocity.mean() for step in steps])
        figure, axis = plt.subplots(figsize=(7, 3.4), layout="constrained")
        axis.fill_between(lengths, *interval.T, color="#e8e8e8", label="every solution")
        axis.plot(lengths, interval[:, 1], color=FORWARD, label="contact 1 slides forward")
        axis.plot(lengths, interval[:, 0], color=BACK, label="contact 0 slides back")
        axis.plot(lengths, chosen, "--", color="black", label="taken here: nearest to zero")
        axis.set(xlabel="actuation L [m]", ylabel="net translation y [m]", xlim=(1.0, 5.0))
        axis.legend(loc="upper left", frameon=False)
        figure.savefig("not_unique.png", dpi=100)

        # 5. Three contacts: triangle and hexagon
        threes = {
            r"$\mu_- > 2 \mu_+$": StasisDomain([1.0] * 3, [3.0] * 3),
            r"$\mu_+ < \mu_- < 2 \mu_+$": StasisDomain([1.0] * 3, [4 / 3] * 3),
        }
        figure = plt.figure(figsize=(9, 8.4), layout="constrained")
        for i, (name, domain) in enumerate(threes.items()):
            box = figure.add_subplot(2, 2, 1 + i, projection="3d", elev=25, azim=25, title=name)
            draw_box_in_space(box, domain)
            polygon = figure.add_subplot(2, 2, 3 + i, xlabel="$T_0$ [N]", ylabel="$T_1$ [N]")
            draw_polygon(polygon, domain, [f"contact {contact}" for contact in range(3)])
            polygon.set(xlim=(-3.0, 2.2), ylim=(-2.1, 3.1))
        figure.savefig("three_contacts.png", dpi=100)

        # 6. A continuous body
        document = load_scene("continuous_segment").document()
        document["body"]["segments"][0] |= {"elements": 100, "accuracy": None}
        segment = simulate(Scene.model_validate(document), duration=3.0)
        strain = np.linspace(0.0, 0.3, 25)
        swept = simulate_many(vary(segment.scene, {"drive.actuation.1.0": strain}))
        closed = np.maximum(strain - 0.1, 0.0) * (0.3 - 0.1) / (0.3 + 0.1)  # l = 1 m, k = 1 N

        figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
        sliding = segment.contact_state[201:].T  # what each contact did in each tick of the third period
        colors = ListedColormap([BACK, "#d8d8d8", FORWARD])
        left.imshow(
            sliding, colors, aspect="auto", origin="lower", extent=(2, 3, 0, 1), vmin=-1, vmax=1, interpolation="none"
        )
        left.set(xlabel="time [s]", ylabel=r"place in the body $\xi$ [m]")
        left.set_title("green: slides forward, red: backward, grey: stands")
        right.plot(strain, swept.per_period, color=CONTACTS[0], label="simulated")
        right.plot(
            strain, closed, "o", markersize=4, markerfacecolor="white", markeredgecolor="black", label="closed form"
        )
        right.set(xlabel=r"largest strain $\Delta\varepsilon$", ylabel="net translation per period [m]")
        right.legend(frameon=False)
        figure.savefig("segment.png", dpi=100)

        # 7. In the plane
        plane = simulate(load_scene("planar_three_points"), duration=3.0)
        position = plane.scene.body.position
        figure, axis = plt.subplots(figsize=(7, 5), layout="constrained")
        for contact in range(3):
            axis.plot(*(position[contact] + plane.displacement[:, contact]).T, color=CONTACTS[0], linewidth=1.0)
        for time, shade in ((0.0, 0.75), (1.0, 0.55), (2.0, 0.35), (3.0, 0.0)):
            body = position + plane.displacement[round(time * plane.rate)]
            axis.plot(*np.vstack((body, body[:1])).T, "o-", color=(shade,) * 3, linewidth=1.4, label=f"t = {time:g} s")
        axis.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
        axis.legend(frameon=False)
        figure.savefig("plane.png", dpi=100)

        # 8. Friction that is commanded
        strategies = {name: load_scene(f"two_anchor_{name.lower()}") for name in "ABC"}
        figure, axes = plt.subplots(4, 1, figsize=(7, 6.4), sharex=True, layout="constrained")
        axes[0].plot(strategies["A"].drive.times, strategies["A"].drive.actuation, color=ACTUATION)
        axes[0].set(ylabel="L [m]", yticks=[0.0, 4.0], title="actuation of all three: $L_{max}$ = 4 m")
        for axis, (name, scene) in zip(axes[1:], strategies.items(), strict=True):
            for contact, line in enumerate(("-", "--")):
                friction = scene.drive.forward[:, contact]
                axis.plot(scene.drive.times, friction, line, color=CONTACTS[contact], label=f"contact {contact}")
            axis.set(
                ylabel="friction [N]", ylim=(0.3, 1.7), yticks=[0.5, 1.0, 1.5], title=rf"strategy {name}, $\mu$ = 1 N"
            )
            axis.grid(alpha=0.3)
        axes[0].legend(handles=axes[1].lines, loc="upper right", frameon=False)  # 1 is in front
        axes[-1].set(xlabel="time [s]", xlim=(0.0, 1.0))
        figure.savefig("strategies.png", dpi=100)

        # 9. The domains of the strategies
        instants = np.array([0.0, 0.2, 0.4, 0.5, 0.6, 0.8])
        boxes = {
            name: [StasisDomain(*mu) for mu in zip(*friction_at(scene, instants), strict=True)]
            for name, scene in strategies.items()
        }
        figure, axes = plt.subplots(3, 6, figsize=(11.5, 6.2), sharex=True, sharey=True, layout="constrained")
        for row, (name, domains) in zip(axes, boxes.items(), strict=True):
            for axis, time, domain in zip(row, instants, domains, strict=True):
                draw_box(axis, domain, reach=1.5, large=False)
                axis.set_title(f"{name}, t = {time:g} s")
            row[0].set_ylabel("T [N]")
        for axis in axes[-1]:
            axis.set_xlabel("$(g_0 + g_1)/2$ [N]")
        figure.savefig("strategy_domains.png", dpi=90)

        # 10. Strategy A over a period
        a = simulate(strategies["A"], duration=1.0, rate=1000.0)
        figure, (above, below) = plt.subplots(
            2, 1, figsize=(9, 6), sharex=True, height_ratios=(1.6, 1), layout="constrained"
        )
        draw_band(above, a)
        below.plot(a.time, a.net_translation - a.net_translation[0], color=CONTACTS[0], linewidth=2.0)
        below.set(xlabel="time [s]", ylabel="net translation y [m]", xlim=(0.0, 1.0), yticks=[0.0, 1.0, 2.0])
        kinks = {"$t_1$": 0.2, "0.25": 0.25, "0.5": 0.5, "$t_1$ + 0.5": 0.7, "\n0.75": 0.75}
        for axis in (above, below):
            for time in kinks.values():
                axis.axvline(time, color="black", linewidth=0.8, linestyle=":")
        below.set_xticks([0.0, *kinks.values(), 1.0], ["0", *kinks, "1"])
        figure.savefig("strategy_a.png", dpi=100)

        # 11. How far each strategy goes
        amplitude = np.linspace(0.0, 6.0, 49)
        gains = {}
        for name, scene in strategies.items():
            gains[name] = simulate_many(vary(scene, {"drive.length": amplitude})).per_period

        body = strategies["A"].document() | {"start": "relaxed"}
        half_a_period_late = strategies["A"].drive.forward[:, ::-1].tolist()  # the contacts have changed places
        drive = {"times": [0, 0.25, 0.5, 0.75, 1], "period": 1.0, "friction": {"isotropic": half_a_period_late}}
        strokes = [np.outer([0, 0.5, 1, 0.5, 0], length).tolist() for length in amplitude]
        scenes = [Scene.model_validate(body | {"drive": drive | {"actuation": stroke}}) for stroke in strokes]
        gains["A, half a period late"] = simulate_many(scenes).per_period

        figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4.2), layout="constrained")
        styles = (("-", CONTACTS[0]), ("-", BACK), ("--", ACTUATION), (":", CONTACTS[0]))
        for (name, gain), (line, color) in zip(gains.items(), styles, strict=True):
            left.plot(amplitude, gain, line, color=color, linewidth=2.2, label=name)
        left.set(xlabel=r"amplitude $k\,L_{max}/\mu$", ylabel=r"net translation per period [$\mu/k$]")
        left.grid(alpha=0.3)
        left.legend(frameon=False)
        for length, line in ((2.0, ":"), (3.0, "-."), (4.0, "--"), (6.0, "-")):
            b = simulate(vary(strategies["B"], {"drive.length": [length]})[0], duration=2.0)
            y = b.net_translation[100:] - b.net_translation[100]
            right.plot(b.time[100:], y, line, color=BACK, label=rf"$k\,L_{{max}}$ = {length:g} $\mu$")
        right.set(xlabel="time [s]", ylabel="net translation y in a period [m]", title="strategy B")
        right.grid(alpha=0.3)
        right.legend(frameon=False)
        figure.savefig("how_far.png", dpi=100)
        return locals()


@contextmanager
def _working_in(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def shrink(picture: Path) -> None:
    """Rewrite a picture in 128 colours, at a third of its size; its note of the matplotlib version is preserved."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    image = Image.open(picture)
    drawn_by = PngInfo()
    drawn_by.add_text("Software", image.info["Software"])
    image.convert("RGB").quantize(128, dither=Image.Dither.NONE).save(picture, optimize=True, pnginfo=drawn_by)


if __name__ == "__main__":
    import matplotlib

    matplotlib.use("Agg")
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURES
    target.mkdir(parents=True, exist_ok=True)
    run(target)
    pictures = list(target.glob("*.png"))
    for picture in pictures:
        shrink(picture)
    print(f"written: {len(pictures)} figures in {target}")
