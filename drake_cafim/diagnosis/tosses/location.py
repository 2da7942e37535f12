"""Where the excess over noise lies in tosses: while the body flies or while it touches, and when."""

import numpy as np
from scipy.stats import chi2

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.intervals_of_time import united
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.thresholds import (
    LOCATION_EXCESS_SHARE,
    LOCATION_P_VALUE,
    TOUCH_SHOWN_DURATION,
    WINDOWS_PER_BLOCK,
)
from drake_cafim.diagnosis.tosses.arc_rows import ArcRows, counted
from drake_cafim.diagnosis.verdict import Location
from drake_cafim.typing import Array

Place = tuple[str, str]


def locate_tosses(problem: ArcRows, model: Model) -> tuple[Location, ...]:
    """The places by their share of the excess χ² under `model`, strongest first, and when it shows."""
    contacts = problem.scene.physics.contacts
    body: Place = ("body", problem.body)
    contact: Place = ("contact", contacts[0].name) if contacts else body
    rows = problem.residual(model)[: problem.rows]
    touching = _touching(problem, model)
    excess: dict[Place, float] = {body: 0.0, contact: 0.0}
    found: dict[tuple[Place, str], list[tuple[float, float]]] = {}
    total_blocks = sum(run.windows // WINDOWS_PER_BLOCK for run in problem.runs)
    for index, z in by_run(problem, rows):
        run, own = problem.runs[index], touching[index]
        for place, part in ((body, ~own), (contact, own)):
            excess[place] += max(float(np.sum(z[part] ** 2)) - z[part].size, 0.0)
        for first in range(0, len(z) - WINDOWS_PER_BLOCK + 1, WINDOWS_PER_BLOCK):
            block = slice(first, first + WINDOWS_PER_BLOCK)
            if chi2.sf(float(np.sum(z[block] ** 2)), z[block].size) * total_blocks < LOCATION_P_VALUE:
                place = contact if np.mean(own[block]) > 0.5 else body
                interval = (float(run.time[first]), float(run.time[min(first + WINDOWS_PER_BLOCK, len(z) - 1)]))
                found.setdefault((place, run.name), []).append(interval)
    total = sum(excess.values())
    locations = []
    for place in sorted(excess, key=lambda one: -excess[one]):
        share = excess[place] / total if total > 0.0 else 0.0
        shown = [run.name for run in problem.runs if (place, run.name) in found]
        words = "while it touches" if place[0] == "contact" else "in flight" if contacts else ""
        for name in shown if share > LOCATION_EXCESS_SHARE else ():
            intervals = united(found[place, name])
            locations.append(Location(*place, share / len(shown), intervals, name, words))
    return tuple(locations)


def _touching(problem: ArcRows, model: Model) -> list[np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """Of each recording's samples whether the body touches, or did a moment ago."""
    shot = problem.shot(model)
    f, arcs = shot.flights.fine, shot.arcs
    touches = f.mode.any(axis=1)
    felt = np.zeros(arcs.times.shape, dtype=bool)
    for b in range(len(arcs.counts)):
        own = (f.flight == b) & touches
        since: Array = arcs.times[b][:, None] - f.time[own][None]
        felt[b] = np.any((since > 0.0) & (since < TOUCH_SHOWN_DURATION), axis=1)
    keep = counted(arcs)
    return [
        np.concatenate([felt[b][keep[b]] for b in np.flatnonzero(arcs.recording == index)])
        for index in range(len(arcs.tracks))
    ]
