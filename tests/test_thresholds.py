"""Thresholds of the diagnosis are in one file, with meaning, unit and calibration; `make thresholds` moves each."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import drake_cafim.diagnosis
from drake_cafim.diagnosis import thresholds
from tests.concealed import move_thresholds
from tests.concealed.moved_diagnosis import moved
from tests.test_concealed_again import NONE, NULL, ODD, UNEXPLAINED, keep, report

FOLDER = Path(drake_cafim.diagnosis.__file__).parent

ITERATIONS = {
    # at most so many steps of an iteration, and what ends it
    "fit/fitting.py": "CONVERGED MOST_CORRECTIONS CORRECTION_TOLERANCE LARGEST_STEP ROUGHLY WEAK",
    "fit/intervals.py": "DOUBLINGS REFINEMENTS",
    "search/cuts.py": "MOST_LEFT_OUT DRAWS",
    "joints/linearised_contact_effects.py": "IMPROVEMENTS",
    "joints/plane_candidates.py": "IMPROVEMENTS",
    "output_error/problem.py": "MOST_STEPS REFIT_STEPS LEAST_DECREASE MOST_DAMPING",
    "output_error/search.py": "MOST_ROUNDS FRICTION_SHARE REACHED_SHARE",
    "output_error/growth.py": "TRIED SETTLED_SHARE",
    "output_error/velocities.py": "MOST_ROUNDS",
    "output_error/moves.py": "CHORD_STEPS",
    "output_error/comparison.py": "FAR NEAR MOST_REPLACED",
    "output_error/scale.py": "PASSES LEAST_GAIN",
    "output_error/candidates.py": "FAR",
    "output_error/starts.py": "MOST_STARTS TOO_MANY",
    "long/fit_of_all.py": "MOST_PASSES SETTLED CHECKED WORSE",
    "long/stretches.py": "MOST_STRETCHES FEWEST_PARTS",
    "joints/unknown_force.py": "MOST_STEPS TOLERANCE",
    "whitening/force_information.py": "PART REACH FAINT FAINT_IN_PRODUCTS DENSE_SHARE",
    "likelihood/flow.py": "TOLERANCE MOST_STEPS",
    "likelihood/whole_recordings.py": "ITERATIONS SETTLED FREEDOMS NEAR WORSE SMALL_DAMPING LARGE_DAMPING",
    "rows/initial_uncertainty.py": "MOST_SWEEPS TOLERANCE",
    "rows/adjustment.py": "CONTRADICTED",
    "rows/trajectory.py": "DENSITIES REFINEMENTS PASSES SETTLED REFUSED",
    "fit/beside.py": "MOST_STEPS MOST_HALVINGS",
    "search/law_shapes.py": "FINER FINEST",
    "search/state.py": "ROUNDS",
    "search/growth_by_place.py": "MOST_ROUNDS MOST_REFUSALS FIRST_ORDER_SHORTFALL",
    "search/pairs_by_place.py": "MOST_STEPS",
    "fit/rivals.py": "FITTED_LEAD REPLACING_LEAD",
    "fit/without_effects.py": "QUARTERS",
    "search/rivals_by_place.py": "MOST_ALONE MOST_PAIRS ROUNDS",
    "whitening/unmodelled_force.py": "DRAWS MOST_STEPS TOLERANCE",
    "tosses/arc_rows.py": "CORRECTIONS",
    "tosses/initial_states.py": "ROUNDS SETTLED NEAR SECOND_LOOKS FIRST_DAMPING HARDER EASIER LEAST_DAMPING",
}
ROUNDING = {
    # what stands for zero or infinity, or is lost in rounding
    "fit/bounds.py": "AT_BOUND IN_VAIN ROUNDING",
    "notes/overstated.py": "NEGLIGIBLE",
    "fit/posterior.py": "NOTHING_KNOWN LEAST_INFORMATION",
    "fit/model.py": "FREE_PRIOR_STD_RATIO HELD_PRIOR_STD_RATIO",
    "fit/robust_covariance.py": "LARGEST_VARIANCE ROUNDING LEAST_SHARE",
    "output_error/likelihood.py": "TINY",
    "output_error/problem.py": "WIDE",
    "left_out/refits.py": "RIDGE",
    "left_out/learned.py": "FAINT",
    "left_out/law_terms.py": "LEAST_RANGE",
    "likelihood/linearised.py": "FREE_POSITION FREE_VELOCITY",
    "noise/stated.py": "LEAST_STD",
    "rows/adjustment.py": "LEAST_STD",
    "rows/coupled_motion.py": "LEAST_SHARE MOST_CHANGE STEPS",
    "rows/trajectory.py": "DIFFUSE",
    "search/determined.py": "AT_BOUND UNSEEN_STD",
    "fit/screening.py": "DIVERGED LEAST_INFORMATION",
    "tosses/innovation.py": "VAGUE",
    "tosses/poses.py": "OFF_CENTRE UNEVEN",
    "whitening/covariance.py": "NONE ROUNDING",
    "whitening/noise_realisations.py": "LEAST_SHARE",
    "whitening/whitened_run.py": "IMPOSSIBLE",
}
APPROXIMATION = {
    # steps of differences, nodes, coefficients, and where a series, a memory or a mean of draws is cut off
    "joints/doubts.py": "OFF",
    "joints/other_noise.py": "INSTANTS",
    "joints/problem.py": "REALISATIONS REALISED_NUMBERS",
    "joints/servo_looks.py": "TRACKED SLOWEST MOST_TRACKED SCANS EACH_SIDE",
    "output_error/starts.py": "SHARE",
    "output_error/errors.py": "FINE_STEP FINEST_STEP",
    "output_error/problem.py": "RELATIVE_STEP",
    "output_error/scale.py": "SIZES",
    "output_error/likelihood.py": "PHASES",
    "output_error/shapes.py": "STICKING",
    "left_out/learned.py": "SMOOTHNESS",
    "left_out/law_terms.py": "DEGREE PIECES POINTS NEAR_ZERO WIDTH_SHARE",
    "likelihood/coordinates.py": "DIFFERENCE SHAPE_STD",
    "likelihood/flow.py": "LONGEST_STEP LONGEST_CONTACT_STEP",
    "likelihood/linearised.py": "READING_STEP",
    "likelihood/transitions.py": "STATE_STEP EFFORT_STEP TERMS STEPS_PER_DERIVATIVE_STEP",
    "noise/coloured.py": "MEMORY",
    "noise/quantised.py": "DECAY ROTATION COHERENT_SAMPLES MOST_SKIPPED LEAST_ROUNDED_SHARE",
    "noise/spectra.py": "FEWEST MAIN_LOBE",
    "noise/differences.py": "DIFFERENCES",
    "noise/fed_back.py": "DIFFERENCES LAGS",
    "predict/innovations.py": "DIFFERENCE RENEWED",
    "predict/servo_input.py": "DIFFERENCE",
    "predict/servo_memory.py": "PAST",
    "predict/stepper.py": "LONGEST_STEP LONGEST_CONTACT_STEP",
    "predict/wrench_innovations.py": "DIFFERENCE",
    "rows/initial_uncertainty.py": "MOST_WINDOWS DECAYED_SHARE",
    "rows/filtered_windows.py": "RESPONSE_SHARE FADING_SHARE",
    "rows/adjustment.py": "POSITION_STEP VELOCITY_STEP",
    "rows/law_points.py": "LARGEST_CHANGE NEAR_ZERO MOST_PIECES GAUSS",
    "rows/servo_efforts.py": "EDGE",
    "tosses/contact_memory_derivatives.py": "SIZES FINE_SIZES SOONER PART",
    "tosses/linearised_effects.py": "GRAIN",
    "tosses/tangent.py": "INSIDE",
    "whitening/impact_noise.py": "JUST_INSIDE RARE_SIDE",
    "whitening/contact_step.py": "NORMAL_STEPS FRICTION_STEPS",
    "whitening/kinked_law_noise.py": "NODES SHARES LEAST_SHARE",
    "whitening/momentum_derivatives.py": "STEP",
}
MEMORY = {
    # how much is kept from one call to the next, or reckoned at once
    "joints/inertial_columns.py": "CACHED",
    "likelihood/transitions.py": "INTERVALS_AT_ONCE",
    "output_error/errors.py": "MOST_WINDOWS MOST_SAMPLES KEPT_READINGS",
    "long/budget.py": "GIB DEFAULT_MEMORY BYTES_BY_PAIR BYTES_BY_COLUMN FIRST_SECONDS SEARCHED_SHARE "
    "PART_SHARE FEWEST_ROWS",
    "long/scan.py": "MOST_INFORMED",
    "joints/linearised_effects.py": "CACHED_ROWS AT_ONCE",
    "noise/coloured.py": "CACHED_ENTRIES ROWS_AT_ONCE",
    "rows/effort_rows.py": "CACHED_TERMS",
    "rows/filtered_windows.py": "LEAST_COEFFICIENT NARROWEST NARROW_PER_PERIOD ROWS_TOGETHER",
    "rows/force_rows.py": "CACHED_TERMS CACHED_FORCES",
    "rows/inertial_regressor.py": "CACHED_REGRESSORS WINDOWS_AT_ONCE",
    "rows/inertial_rows.py": "CACHED",
    "rows/initial_uncertainty.py": "CACHED_LAGS",
    "rows/kinematic_rows.py": "CACHED_LAGS",
    "rows/mobility.py": "CACHED",
    "tosses/pulses.py": "TOGETHER",
    "rows/velocity_smoothing.py": "CACHED_STDS",
    "whitening/lasting_noise.py": "INSTANTS_AT_ONCE",
    "whitening/joint_forces.py": "KEPT",
    "whitening/whitened_run.py": "CACHED_STARTS",
}
DERIVED = {
    # what follows from a threshold
    "fit/evidence.py": "FAR_UNKNOWN_SURPRISE",
}
FIGURES = {
    "verdict.py": "TOLD_TOGETHER",
    # what figures and words of the report are defined by; the verdict does not read them
    "notes/effort_scale.py": "DETERMINED",
    "notes/recording_notes.py": "BEYOND",
    "left_out/law_words.py": "REPEATING_SHARE FEWEST_PERIODS MOST_PERIODS FLAT_SHARE MEAN_SHARE STEP_SHARE ALIKE",
    "predict/whole_run.py": "DEGREE",
    "predict/forecast.py": "HORIZON SHORT_HORIZON BOUNDLESS",
    "predict/initial_state.py": "LOOK_BACK",
    "noise/filters.py": "SEGMENT FEWEST PASSED",
    "predict/inverse_dynamics.py": "BEYOND_MAKERS CUTOFF LARGEST_SHARE NYQUIST_SHARE ORDER SHORTEST TRANSIENT WIDER",
    "predict/innovations.py": "SEGMENT",
    "search/candidate_decisions.py": "NOISE_ALLOWED",
    "search/decisions.py": "REFUSED",
    "fit/goodness_of_fit.py": "PLACES",
    "tosses/pictures.py": "TOGETHER",
    "tosses/poses.py": "LEVER",
    "tosses/quality.py": "LOST",
}
STRUCTURE = {
    # sizes of things, how many there are, and numbers that stand for names
    "search/cuts.py": "BLOCKS _HALVES",
    "fit/adequacy.py": "KINDS",
    "output_error/errors.py": "BLOCKS",
    "output_error/velocities.py": "LENGTH",
    "left_out/parts.py": "MOST_PARTS",
    "left_out/refits.py": "UNKNOWNS",
    "rows/inertial_regressor.py": "INERTIAL",
    "rows/test_functions.py": "OVERLAPPING",
    "tosses/arc_rows.py": "FIRST",
    "tosses/poses.py": "QUATERNION",
    "tosses/compiled_contact.py": "FRICTIONLESS SLIPPING RESISTING CUBIC DISSIPATION RELAXING TIME ROLLING STATIC "
    "VELOCITY DISTANCE OF_LAW STRIBECK ANISOTROPIC PRESLIDING",
}
UNITS = {
    # how many of a unit make another one, and rotations between customary frames
    "notes/suspicions.py": "THOUSAND TURNS ZEROS",
    "tosses/data_mistakes.py": "MILLIMETRES HALF FRAMES",
}
OF_CLASSES = {
    # where a fit ends, and how it damps its steps; of a sample, its rows
    "fit/problem.py": "Problem.least_gain Problem.least_damping",
    "tosses/arc_rows.py": "ArcRows.least_gain ArcRows.slack ArcRows.least_damping TossRun.rows_per_window",
}
"""Numbers that classes define, by file, and why they are none of the thresholds."""
MAY_STAY = (DERIVED, ITERATIONS, ROUNDING, APPROXIMATION, MEMORY, FIGURES, STRUCTURE, UNITS)
"""Numbers at module level that no verdict turns on: by file, and why they are none of the thresholds."""


def numbers_of(text: str) -> Iterator[str]:
    """Names that a module assigns a number to, or something made of numbers, at its top level."""
    for node in ast.parse(text).body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        if any(isinstance(part, ast.Constant) and type(part.value) in (int, float) for part in ast.walk(node.value)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            yield from (part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name))


def numbers_of_classes(text: str) -> Iterator[str]:
    """Class variables, and fields with a default, to which a class assigns a number, as "Class.name".

    0 and 1 are not counted: as a default they mean none, or unchanged.
    """
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ClassDef):
            for part in node.body:
                value = part.value if isinstance(part, ast.Assign | ast.AnnAssign) else None
                leaves = ast.walk(value) if value is not None else ()
                numbers = {leaf.value for leaf in leaves if isinstance(leaf, ast.Constant)}
                if any(type(number) in (int, float) and number not in (0, 1) for number in numbers):
                    yield from (f"{node.name}.{name}" for name in numbers_of(ast.unparse(part)))


def test_no_number_that_steers_a_verdict_is_hidden_in_a_class() -> None:
    found = {
        f"{path.relative_to(FOLDER).as_posix()} {name}"
        for path in FOLDER.rglob("*.py")
        for name in numbers_of_classes(path.read_text())
    }
    assert found == {f"{file} {name}" for file, names in OF_CLASSES.items() for name in names.split()}


def test_no_number_that_steers_a_verdict_stands_outside_the_file_of_thresholds() -> None:
    found = {
        f"{path.relative_to(FOLDER).as_posix()} {name}"
        for path in FOLDER.rglob("*.py")
        if path.name != "thresholds.py"
        for name in numbers_of(path.read_text())
    }
    listed = [f"{file} {name}" for group in MAY_STAY for file, names in group.items() for name in names.split()]
    assert len(set(listed)) == len(listed)
    assert found - set(listed) == set(), "belongs into diagnosis/thresholds.py, or with a reason into a list here"
    assert set(listed) - found == set(), "is listed here, and no longer there"


def test_numbers_are_found_wherever_they_hide() -> None:
    text = "A = 1.0\nB, C = 2, (3.0, 'x')\nD: float = -4\nE = A\nF = np.array([1])\nG = True\ndef f():\n    H = 2\n"
    assert list(numbers_of(text)) == ["A", "B", "C", "D", "F"]


def documented() -> dict[str, str]:
    """Each threshold's docstring, the string below it."""
    body = ast.parse((FOLDER / "thresholds.py").read_text()).body
    found = {}
    for node, below in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.Assign):
            assert isinstance(node.targets[0], ast.Name), "one threshold an assignment"
            text = below.value if isinstance(below, ast.Expr) else None
            found[node.targets[0].id] = str(text.value) if isinstance(text, ast.Constant) else ""
    return found


def test_every_threshold_says_its_meaning_its_unit_and_what_calibrated_it() -> None:
    found = documented()
    assert set(found) == {name for name in vars(thresholds) if name.isupper()}
    form = re.compile(r"\S[^.]{20,}.*Unit: [^.]+\. (Not calibrated: chosen|Calibrated by: .+|Source: .+)\.", re.DOTALL)
    formless = [
        name
        for name, text in found.items()
        if not form.fullmatch(" ".join(text.split()).replace("Not calibrated: chosen,", "Source:"))
    ]
    assert formless == []
    assert [name for name in found if "_" not in name] == []


def test_every_threshold_is_read_somewhere_and_those_to_be_replaced_exist() -> None:
    texts = [path.read_text() for path in FOLDER.parent.rglob("*.py") if path.name != "thresholds.py"]
    names = set(documented())
    unread = [name for name in names if not any(re.search(rf"\b{name}\b", text) for text in texts)]
    assert unread == []
    assert names >= move_thresholds.REPLACED_LATER
    assert set(move_thresholds.movable()) == names - move_thresholds.REPLACED_LATER


def test_a_threshold_is_moved_by_a_third() -> None:
    assert moved(3.0, 4.0 / 3.0) == 4.0 and moved((3.0, 6.0), 2.0 / 3.0) == (2.0, 4.0)
    assert (moved(12, 4.0 / 3.0), moved(1, 4.0 / 3.0), moved(2, 2.0 / 3.0), moved(8, 2.0 / 3.0)) == (16, 2, 1, 5)


def test_a_child_reads_the_moved_threshold() -> None:
    code = """
import sys
from tests.concealed.moved_diagnosis import move
assert "drake_cafim.diagnosis.fit.evidence" not in sys.modules
move("MISFIT_REDUCED_CHI_SQUARE", 2.0)
from drake_cafim.diagnosis.fit import evidence
print(evidence.MISFIT_REDUCED_CHI_SQUARE)
"""
    root = Path(__file__).resolve().parents[1]
    told = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True).stdout
    assert float(told) == 2.0 * thresholds.MISFIT_REDUCED_CHI_SQUARE


def test_moves_are_run_resumed_and_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    proof, out = tmp_path / "proof", tmp_path / "moves"
    for slot, truth in enumerate((NULL, NULL, ODD)):
        keep(proof, slot, truth, report("none"), (NONE, NONE, UNEXPLAINED)[slot])
    steering, other, *_ = move_thresholds.movable()
    monkeypatch.setattr(move_thresholds, "movable", lambda: [steering, other])
    started: list[list[str]] = []

    def diagnose(line: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        started.append(line)
        case, target = Path(line[line.index("diagnose") + 1]).parent.name, Path(line[line.index("--out") + 1])
        found = report("unexplained" if case == "case2" else "none")
        if line[3:5] == [steering, str(4.0 / 3.0)] and case == "case2":
            found = report("unexplained", "payload")
        found["mismatch"] = {"locations": [], "p_value": 0.2 if line[3:5] == [other, str(2.0 / 3.0)] else 0.1}
        target.mkdir(parents=True)
        (target / "report.json").write_text(json.dumps(found))
        return subprocess.CompletedProcess(line, 0, "", "")

    monkeypatch.setattr(move_thresholds.subprocess, "run", diagnose)
    arguments = [str(proof), "--out", str(out), "--cases", "2"]
    move_thresholds.main(arguments)
    told = capsys.readouterr().out
    assert "2 thresholds, 2 cases, 10 diagnoses: about 0.0 hours" in told and len(started) == 10
    assert {Path(line[line.index("diagnose") + 1]).parent.name for line in started} == {"case0", "case2"}
    assert f"{steering} = {getattr(thresholds, steering)}, up: 1 of 2 with another outcome" in told
    assert "worse: odd:odd_gusts on arm2: unexplained → unexplained payload@link3" in told
    assert f"{other} = {getattr(thresholds, other)}, down: 0 of 2 with another outcome, 2 with other numbers" in told
    with pytest.raises(SystemExit, match="not empty"):
        move_thresholds.main(arguments)
    next((out / "runs").iterdir()).unlink()
    move_thresholds.main([*arguments, "--resume"])
    assert len(started) == 11
