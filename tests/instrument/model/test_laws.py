"""What holds for every crawler, over random bodies of every kind, by every method."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from crawler_model import Crawler, Scene, Step, simulate
from crawler_model.body.curves import list_sliders

from .bodies import (
    BENT,
    BENT_WHERE_BOUNDS_CHANGE,
    BETWEEN_WALLS,
    CHAMBERS,
    HYSTERETIC,
    IN_THE_PLANE,
    LOOSE,
    ON_A_LINE,
    ON_GRADUAL_GROUND,
    ON_PATCHES,
    SWELLING,
    TOLERANCE,
    Drawn,
    Driven,
    drawn,
)
from .chains import from_rows

STEPPED = [
    (kind, "catch_up") for kind in (*ON_A_LINE, CHAMBERS, *BENT, *HYSTERETIC, *LOOSE, *SWELLING, *ON_GRADUAL_GROUND)
]
"""Methods that take one implicit step a ramp."""
FOLLOWED = [
    *(
        (kind, "exact")
        for kind in (
            *ON_A_LINE,
            CHAMBERS,
            *BENT,
            *HYSTERETIC,
            *LOOSE,
            *ON_PATCHES,
            *BETWEEN_WALLS,
            *SWELLING,
            *ON_GRADUAL_GROUND,
            *BENT_WHERE_BOUNDS_CHANGE,
        )
    ),
    *((kind, "catch_up") for kind in IN_THE_PLANE),
]
"""Methods that follow the path itself, to rounding on a line, to a tolerance in the plane."""
EVERY = [*FOLLOWED, *STEPPED]


def law(*variants: tuple[str, str], **strategies):
    """Run a test for every kind of body and method, with several random bodies each."""

    def decorate(test):
        examples = max(settings.default.max_examples // 5, 1)

        @pytest.mark.parametrize(("kind", "method"), variants)
        @settings(max_examples=examples)
        @given(data=st.data())
        def run(kind, method, data):
            chosen = {name: data.draw(strategy) for name, strategy in strategies.items()}
            test(data.draw(drawn(kind)), method, **chosen)

        run.__name__, run.__doc__ = test.__name__, test.__doc__
        return run

    return decorate


def within(body: Driven, ramps: int = 1) -> float:
    """Return how far two answers may lie apart, of so many ramps in the plane [m]."""
    share = TOLERANCE * ramps if body.scene.body.dimension == 2 else 1e-11
    return share * body.extent


def known(
    body: Drawn, steps: list[Step], parts: int = 1, doubtful: tuple[str, ...] = ("bent", "gradual")
) -> np.ndarray:
    """Return after which ramps the state is determined: flat springs, and ground that lets go as they do, may leave it
    open, and what follows from it."""
    sound = [step.unique and not step.unsolved and not step.overspent for step in steps]
    each = np.array(sound) | all(kind not in body.kind for kind in doubtful)
    return np.logical_and.accumulate(each)[parts - 1 :: parts]


def energy(crawler: Crawler) -> float:
    """Return the energy of the springs, of linear ones from their tensions [J]."""
    return crawler.stored


def scale_of(crawler: Crawler, step: Step) -> float:
    """Return the energy that rounding is measured by [J]."""
    force = np.abs(crawler.tension).max() + crawler.friction.max()
    return float(abs(step.work) + step.dissipation + energy(crawler) + force * np.abs(crawler.actuation).max())


HARD = (
    Drawn("chain on patches", 1629, commanded=True, bare=True),
    Drawn("graph on patches", 366, ties=True, bare=True),
    Drawn("graph on patches", 381, commanded=True, bare=True),
    Drawn("graph on patches", 806, ties=True, bare=True),
    Drawn("graph on patches", 1726, ties=True, bare=True),
    Drawn("bent chain", 1995, commanded=True, ties=True),
    Drawn("bent chain", 2262, ties=True),
    Drawn("bent chain", 3047, commanded=True, ties=True),
    Drawn("bent graph", 950, ties=True),
    Drawn("bent graph", 1333, commanded=True),
    Drawn("bent graph", 1844),
    Drawn("bent graph", 2140),
    Drawn("bent hybrid", 39, commanded=True),
    Drawn("bent hybrid", 202),
    Drawn("bent hybrid", 208),
    Drawn("bent chain on patches", 963, commanded=True, ties=True),
    Drawn("bent chain on patches", 3399, commanded=True, ties=True),
    Drawn("bent chain on patches", 4147, commanded=True, ties=True),
)
"""Bodies with forces beyond bounds, with a wrong balance of energy, or without a solution, until that was mended."""


@pytest.mark.parametrize(("kind", "method"), [row for row in EVERY if row[0] not in IN_THE_PLANE])
def test_every_ramp_is_solved_and_balances(kind, method):
    bodies = [Drawn(kind, seed, bool(seed & 1), bool(seed & 2), bool(seed & 4)) for seed in range(60)]
    for body in (*bodies, *(hard for hard in HARD if hard.kind == kind)):
        crawler = Crawler(body.driven().scene, method)
        for target in crawler.scene.drive.targets[1:]:
            step = crawler.follow(target[None].copy())
            size = 1.0 + abs(step.work)
            assert step.unsolved == step.overspent == 0, body
            assert step.certificate.violation < 1e-10 * size, body
            assert method == "catch_up" or abs(step.certificate.energy_residual) < 1e-11 * size, body


TIED = (
    Drawn("bent graph", 14544, commanded=True, ties=True),
    Drawn("bent graph", 14545, commanded=True, ties=True),
    Drawn("bent graph", 30004, ties=True),
    Drawn("bent graph", 30132, ties=True),
    Drawn("bent chain", 30559, commanded=True, ties=True, bare=True),
    Drawn("bent chain on patches", 30038, ties=True, bare=True),
    Drawn("bent chain on patches", 30583, commanded=True, ties=True, bare=True),
)
"""Where a knot and a bound are met together: a motor begins to stall as its contact begins to slide; a slack part slides
off; a spring leaves its stop as a contact stops; a tendon without tension joins contacts that move together; a spring at
rest becomes flat as another one does; a part slides onto a border, and another onto ice, just as nothing else holds it."""


def compare_rates(body: Drawn, method: str, rate: float) -> None:
    """Simulate a body at 1 Hz and at another rate, and compare what is reported."""
    one, other = (simulate(body.driven().scene, method=method, rate=r) for r in (1.0, rate))
    bound = within(body.driven(), 10 + int(5 * rate))
    if "gradual" in body.kind and (one.unsolved or other.unsolved):
        return
    assert other.unique == one.unique
    if ("bent" in body.kind or "gradual" in body.kind) and not one.unique:
        return
    assert other.waypoint_displacement == pytest.approx(one.waypoint_displacement, abs=bound)
    if not Crawler(body.driven().scene, method).visited_margin_sampled:
        assert other.visited_margin == pytest.approx(one.visited_margin, abs=1e-11)


@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_which_contacts_can_begin_a_jump_does_not_depend_on_the_rates_of_commands(rate):
    """Commands rest while contacts are moved to see: one beside another that could not begin counted as a second one."""
    compare_rates(Drawn("chain on gradual ground", 1122816), "exact", rate)


@pytest.mark.parametrize("rate", [0.5, 2.0])
def test_a_body_that_jumps_onto_ground_that_holds_nothing_is_free_at_all_rates(rate):
    """As the bound of its last contact falls to 0, all others meet theirs: rounding decides which is first."""
    run = simulate(Drawn("segment on patches", 462, ties=True, bare=True).driven().scene, rate=rate)
    assert not run.unique


@law(*FOLLOWED, rate=st.floats(0.1, 20.0))
def test_the_path_matters_and_the_speed_does_not(body, method, rate):
    compare_rates(body, method, rate)


@pytest.mark.parametrize(
    ("seed", "rate"),
    [(1, 12.0), (1, 12.562), (515, 3.0), (1801, 3.0), (1801, 16.0), (1827, 2.0), (2499, 7.3), (2877, 12.562)],
)
def test_the_margin_just_before_a_border_at_the_end_of_a_ramp_is_seen_at_all_rates(seed, rate):
    """A contact comes to a border, behind which its friction differs, exactly at a waypoint or as another one does."""
    compare_rates(Drawn("chain on patches", seed, commanded=False, ties=True, bare=True), "exact", rate)


@pytest.mark.parametrize("body", TIED, ids=lambda body: str(body.seed))
@pytest.mark.parametrize("rate", [3.0, 4.0])
def test_a_knot_and_a_bound_that_are_met_together_are_judged_alike_at_all_rates(body, rate):
    compare_rates(body, "exact", rate)


@law(*FOLLOWED, parts=st.integers(2, 9))
def test_a_ramp_split_in_parts_leads_to_the_same_place(body, method, parts):
    """Which of several solutions follows tied jumps on patches, rounding decides."""
    whole, steps = body.driven().run(method)
    split, others = body.driven().run(method, parts)
    doubtful = ("bent", "gradual", "patches")
    sure = known(body, steps, 1, doubtful) & known(body, others, parts, doubtful)
    assert split[sure] == pytest.approx(whole[sure], abs=within(body.driven(), 5 * (parts + 1)))


@law(*STEPPED)
def test_catch_up_on_small_ramps_is_exact(body, method):
    """Its error is of first order in the length of a ramp."""
    exact, steps = body.driven().run("exact")
    sure, wrong = known(body, steps), []
    for parts in (8, 128):
        found, others = body.driven().run(method, parts)
        both = sure & known(body, others, parts)
        wrong.append(np.abs(found - exact)[both].max(initial=0.0))
    assert wrong[1] <= max(wrong[0] / 4.0, 0.05 * body.driven().extent)


@law(*EVERY)
def test_the_energy_account_is_that_of_the_springs(body, method):
    crawler = Crawler(body.driven().scene, method)
    before = energy(crawler)
    for row in body.driven().rows:
        step = crawler.advance(*row)
        residual = energy(crawler) - before + step.dissipation + step.internal_dissipation + step.jump_loss
        residual -= step.work + step.loads_work
        assert residual == pytest.approx(step.certificate.energy_residual, abs=1e-12 * scale_of(crawler, step))
        assert step.dissipation >= 0.0
        assert step.internal_dissipation >= 0.0
        assert step.jump_loss >= 0.0
        before = energy(crawler)


def test_a_slider_gives_no_energy_back():
    """Its slip is a difference of rounded lengths, here a hair against the force."""
    body = Drawn("hysteretic chain", seed=14, commanded=True, ties=True, bare=False).driven()
    crawler = Crawler(body.scene, "catch_up")
    assert all(crawler.advance(*row).internal_dissipation >= 0.0 for row in body.rows)


@law(*FOLLOWED)
def test_the_certificate_of_a_followed_ramp_is_rounding(body, method):
    """In the plane it is what the tolerance makes of forces and energies."""
    crawler = Crawler(body.driven().scene, method)
    for row in body.driven().rows:
        step = crawler.advance(*row)
        if ("bent" in body.kind or "gradual" in body.kind) and (step.unsolved or step.overspent):
            return
        force = 1e-12 * (np.abs(crawler.tension).max() + crawler.friction.max())
        work = 1e-12 * scale_of(crawler, step)
        if method != "exact":
            force = 50 * crawler.body.stiffness.max() * within(body.driven())
            work += force * np.abs(step.velocity).max()
        assert step.certificate.violation <= force
        assert abs(step.certificate.energy_residual) <= work
        if method == "exact":
            assert step.certificate.complementarity <= work


@law(*STEPPED)
def test_the_certificate_of_catch_up_shows_its_error(body, method):
    residual = [sum(abs(s.certificate.energy_residual) for s in body.driven().run(m)[1]) for m in ("exact", method)]
    wrong = np.abs(body.driven().run(method)[0] - body.driven().run("exact")[0]).max()
    assume(wrong > 1e-6)
    assert residual[1] > residual[0]


@law(*EVERY)
def test_the_mirror_image(body, method):
    here, steps = body.driven().run(method)
    there, others = body.driven(mirrored=True).run(method)
    back = -there if here.ndim == 3 else -there[:, ::-1]
    sure = known(body, steps) & known(body, others)
    assert back[sure] == pytest.approx(here[sure], abs=within(body.driven(), 10))


@law(*((kind, method) for kind, method in EVERY if kind not in IN_THE_PLANE))
def test_where_the_body_stands_does_not_matter(body, method):
    """With the patches and the walls around it; by a length that rounds no position."""
    here, steps = body.driven().run(method)
    there, others = body.driven().moved(64.0).run(method)
    sure = known(body, steps)
    assert (known(body, others) == sure).all()
    assert there[sure] == pytest.approx(here[sure], abs=100 * within(body.driven(), 10))


@law(*(row for row in EVERY if not any(word in row[0] for word in ("bent", "segment", CHAMBERS))))
def test_the_numbers_of_links_and_contacts_do_not_matter(body, method):
    """On a line contacts are numbered as they lie."""
    here, steps = body.driven().run(method)
    other, order = body.driven().renumbered(body.seed)
    there, others = other.run(method)
    order = np.append(order, np.arange(order.size, here.shape[1]))
    sure = known(body, steps) & known(body, others)
    assert there[sure] == pytest.approx(here[:, order][sure], abs=within(body.driven(), 10))
    assert [step.unique for step in others] == [step.unique for step in steps]


SCALES = st.sampled_from([1e-9, 1e-3, 7.0, 1e9])


@law(*EVERY, length=SCALES, force=SCALES)
def test_units_do_not_matter(body, method, length, force):
    here, steps = body.driven().run(method)
    there, others = body.driven(length, force).run(method)
    sure = known(body, steps) & known(body, others)
    assert there[sure] / length == pytest.approx(here[sure], abs=within(body.driven(), 10))
    for one, other in itertools.compress(zip(steps, others, strict=True), sure):
        bound = 100 * within(body.driven(), 10)
        assert other.work / (length * force) == pytest.approx(one.work, abs=bound)
        assert other.dissipation / (length * force) == pytest.approx(one.dissipation, abs=bound)
        assert other.unique == one.unique


@law(*EVERY)
def test_same_input_same_bits(body, method):
    one, two = (simulate(body.driven().scene, method=method, rate=3.0) for _ in range(2))
    for name in ("displacement", "tension", "net_translation", "contact_state", "waypoint_displacement"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()


@law(*EVERY)
def test_a_copy_goes_its_own_way(body, method):
    rows = body.driven().rows
    crawler = Crawler(body.driven().scene, method)
    crawler.advance(*rows[0])
    fork = crawler.copy()
    assert fork == crawler
    for row in rows[1:]:
        fork.advance(*row)
    assert fork != crawler or np.array_equal(rows[0][0], rows[-1][0])
    for row in rows[1:]:
        crawler.advance(*row)
    assert fork == crawler


@law(*EVERY)
def test_moving_contacts_are_at_the_bound_that_opposes_them(body, method):
    crawler = Crawler(body.driven().scene, method)
    before, mesh = crawler.displacement, crawler.body
    for row in body.driven().rows:
        step = crawler.advance(*row)
        assert crawler.displacement - before == pytest.approx(step.velocity, abs=1e-11)
        if before.ndim == 1:
            assert (np.sign(step.velocity) == crawler.contact_state).all()
        else:
            assert (np.hypot(*step.velocity.T)[crawler.contact_state == 0] == 0.0).all()
        elongation = crawler.displacement[mesh.ends[:, 1]] - crawler.displacement[mesh.ends[:, 0]]
        assert crawler.shape == pytest.approx(elongation, abs=1e-11)
        tension = mesh.tension(crawler.shape, crawler.actuation)
        for slider, held in zip(list_sliders(mesh.bends), crawler.hysteresis, strict=True):
            assert abs(held) <= slider[2] * (1.0 + 1e-12)
            tension[int(slider[0])] += held
        assert crawler.tension == pytest.approx(tension, abs=1e-11 * 9 * mesh.stiffness.max())
        before = crawler.displacement


@law(*EVERY)
def test_a_hold_changes_nothing(body, method):
    crawler = Crawler(body.driven().scene, method)
    if not known(body, [crawler.advance(*body.driven().rows[0])]).all():
        return
    held = crawler.copy()
    step = held.advance(*body.driven().rows[0])
    for name in ("displacement", "shape", "tension", "hysteresis", "net_translation", "actuation", "friction"):
        assert np.array_equal(getattr(held, name), getattr(crawler, name))
    assert not held.contact_state.any()
    assert step.events == 0
    assert step.work == 0.0


def test_a_scene_of_the_oracle_survives_a_round_trip():
    scene = from_rows(*(np.ones(2), np.zeros((2, 2)), np.ones((2, 3)), np.ones((2, 3))))
    assert Scene.model_validate(scene.document()) == scene
