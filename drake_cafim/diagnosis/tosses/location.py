"""Location of a toss's excess of χ² over noise: in flight or in contact, and in which intervals."""

import numpy as np

from drake_cafim.diagnosis.fit.adequacy import by_run
from drake_cafim.diagnosis.fit.excess import Excess, Place, count_blocks, significant_blocks
from drake_cafim.diagnosis.fit.model import Model
from drake_cafim.diagnosis.thresholds import TOUCH_SHOWN_DURATION
from drake_cafim.diagnosis.tosses.arc_rows import ArcRows, innovation_mask
from drake_cafim.diagnosis.verdict import Location
from drake_cafim.typing import Array


def locate_tosses(problem: ArcRows, model: Model) -> tuple[Location, ...]:
    """The body (in flight) and the contact, by their share of the excess χ² under `model`, with its intervals."""
    contacts = problem.scene.physics.contacts
    body: Place = ("body", problem.body)
    contact: Place = ("contact", contacts[0].name) if contacts else body
    rows = problem.residual(model)[: problem.rows]
    touching = _touching_samples(problem, model)
    excess = Excess.at([body, contact])
    blocks = sum(count_blocks(run.windows) for run in problem.runs)
    for index, z in by_run(problem, rows):
        run, own = problem.runs[index], touching[index]
        for place, part in ((body, ~own), (contact, own)):
            excess.add(place, z[part] ** 2)
        for block in significant_blocks(z**2, blocks):
            interval = (float(run.time[block.start]), float(run.time[min(block.stop, len(z) - 1)]))
            excess.show(contact if np.mean(own[block]) > 0.5 else body, run.name, [interval])

    def condition(place: Place) -> str:
        return "while it touches" if place[0] == "contact" else "in flight" if contacts else ""

    return excess.locations([run.name for run in problem.runs], condition)


def _touching_samples(problem: ArcRows, model: Model) -> list[np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """For each recording's samples that count: whether the body touched within the last `TOUCH_SHOWN_DURATION`."""
    shot = problem.shot(model)
    f, arcs = shot.flights.fine, shot.arcs
    touches = f.mode.any(axis=1)
    shown = np.zeros(arcs.times.shape, dtype=bool)
    for b in range(len(arcs.counts)):
        own = (f.flight == b) & touches
        since: Array = arcs.times[b][:, None] - f.time[own][None]
        shown[b] = np.any((since > 0.0) & (since < TOUCH_SHOWN_DURATION), axis=1)
    keep = innovation_mask(arcs)
    return [
        np.concatenate([shown[b][keep[b]] for b in np.flatnonzero(arcs.recording == index)])
        for index in range(len(arcs.tracks))
    ]
