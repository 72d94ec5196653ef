"""Frames as plain arrays, for the page and the film of a recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crawler_model import CrawlerError, Scene
from crawler_model.body.drive import NS
from crawler_model.body.names import name_joints
from crawler_model.theory.stasis import stasis_bounds
from crawler_pictures.film.film import Film
from crawler_pictures.ground import has_stasis_bounds
from crawler_pictures.run.arrays import RunArrays, sort_commands

from ..wire.states import station_names
from .frames import Frame


def film_of_frames(scene: Scene, frames: Sequence[Frame]) -> Film:
    """Stack frames to a run whose instants are the frames: stations as contacts, joints as springs.

    Args:
        scene: the scene.
        frames: the frames in sequence, at least one.

    Returns:
        The film.

    Raises:
        CrawlerError: when there is no frame.
    """
    if not frames:
        raise CrawlerError(f"{scene.name}: there is no state to draw")
    body = scene.body
    rest = body.position[body.stations]
    return Film(
        scene=scene,
        names=tuple(name.removeprefix("contact_") for name in station_names(body)),
        rest=rest,
        ends=body.joints,
        share=body.station_share,
        time=np.array([f.time_ns for f in frames]) / NS,
        displacement=np.array([f.displacement.reshape(rest.shape) for f in frames]),
        state=np.array([f.state for f in frames]),
        tension=np.array([f.tension for f in frames]),
        forward=np.array([f.forward for f in frames]),
        backward=np.array([f.backward for f in frames]),
        yields=np.array([f.yields for f in frames]),
    )


def run_of_frames(scene: Scene, frames: Sequence[Frame]) -> RunArrays:
    """Stack frames to the arrays of a page.

    Args:
        scene: the scene.
        frames: the frames in sequence, at least one.

    Returns:
        The arrays.

    Raises:
        CrawlerError: when there is no frame.
    """
    film, body = film_of_frames(scene, frames), scene.body
    least = most = np.full(film.tension.shape, np.nan)
    if has_stasis_bounds(body):
        least, most = stasis_bounds(film.tension, film.forward, film.backward)
    return RunArrays(
        title=scene.name,
        notes=("net translation from the ends of segments",) if body.segments else (),
        time=film.time,
        positions=film.place,
        state=film.state,
        net_translation=film.net_translation,
        tension=film.tension,
        least=least,
        most=most,
        contacts=tuple(station_names(body)),
        links=tuple(name_joints(body)[: len(body.joints)]),
        place=film.rest,
        ends=film.ends,
        commands=sort_commands(scene.columns, np.array([f.row for f in frames])),
        jumps=[jump for frame in frames for jump in frame.jumps],
        scene=None if body.turning is not None else scene,  # its friction has no fixed directions to draw
        share=film.share,
        marks=film.yields,
    )
