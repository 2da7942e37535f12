"""The studies by name."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from drake_cafim.studies.averaging import averaging, averaging_cells
from drake_cafim.studies.behaviour import behaviour, behaviour_cells
from drake_cafim.studies.cell import Cell
from drake_cafim.studies.claims import claim_cells, claims
from drake_cafim.studies.comparisons import (
    convergence,
    convergence_cells,
    criteria,
    criteria_cells,
    planner_cells,
    planners,
)
from drake_cafim.studies.disturbances import disturbance_cells, disturbances, frame_cells
from drake_cafim.studies.findings import Findings
from drake_cafim.studies.guarding import guarding, guarding_cells
from drake_cafim.studies.identifiability import identifiability, identifiability_cells
from drake_cafim.studies.landscapes import landscape_cells, landscapes
from drake_cafim.studies.laws import law_cells, laws
from drake_cafim.studies.noise import noise, noise_cells
from drake_cafim.studies.one_rub import one_rub, one_rub_cells
from drake_cafim.studies.point_contact import point_contact, point_contact_cells
from drake_cafim.studies.printed import printed, printed_cells
from drake_cafim.studies.priors import calibration, calibration_cells, robustness, robustness_cells
from drake_cafim.studies.reaching import reaching, reaching_cells
from drake_cafim.studies.requirements import requirement_cells, requirements
from drake_cafim.studies.robots import world_cells, worlds
from drake_cafim.studies.worlds import hefting_table, hefting_table_cells


@dataclass(frozen=True)
class Study:
    """A study: `cells(short)` lists its runs, in full or few of them; `conclude(results)` gives its findings."""

    cells: Callable[[bool], list[Cell]]
    conclude: Callable[[Mapping[Cell, Any]], Findings]


STUDIES: Mapping[str, Study] = {
    "requirements": Study(requirement_cells, requirements),
    "requirements-robots": Study(partial(requirement_cells, world="model"), requirements),
    "claims": Study(claim_cells, claims),
    "convergence": Study(convergence_cells, convergence),
    "robustness": Study(robustness_cells, robustness),
    "robustness-robots": Study(partial(robustness_cells, world="model"), robustness),
    "calibration": Study(calibration_cells, calibration),
    "calibration-robots": Study(partial(calibration_cells, world="model"), calibration),
    "behaviour": Study(behaviour_cells, behaviour),
    "criteria": Study(criteria_cells, criteria),
    "planners": Study(planner_cells, planners),
    "noise": Study(noise_cells, noise),
    "belief-averaging": Study(averaging_cells, averaging),
    "identifiability": Study(identifiability_cells, identifiability),
    "force-guard": Study(guarding_cells, guarding),
    "landscapes": Study(landscape_cells, landscapes),
    "one-rub": Study(one_rub_cells, one_rub),
    "disturbances": Study(lambda short: [*disturbance_cells(short), *frame_cells(short)], disturbances),
    "point-contact": Study(point_contact_cells, point_contact),
    "reaching": Study(reaching_cells, reaching),
    "worlds": Study(world_cells, worlds),
    "laws": Study(law_cells, laws),
    "as-printed": Study(printed_cells, printed),
    "hefting-table": Study(hefting_table_cells, hefting_table),
}
