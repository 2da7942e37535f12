"""A stand-in for `cafim diagnose` in tests of the proof: writes a valid report from a few columns, without a fit."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import yaml


def main() -> int:
    arguments = sys.argv[1:]
    out = Path(arguments[arguments.index("--out") + 1])
    scenario = yaml.safe_load(Path(arguments[0]).read_text())
    out.mkdir(parents=True)
    names = [key for key in scenario["channels"] if "." in key]
    guess = len(Path(arguments[0]).read_text()) % 3
    explanation = []
    if guess == 1:
        explanation = [
            {
                "effect": "surface_offset" if names else "payload",
                "at": "wall" if names else "link2",
                "probability": 0.9,
                "parameters": {"offset" if names else "mass": {"value": 0.001, "std": 0.0002, "unit": ""}},
                "sentence": "",
            }
        ]
    report = {
        "schema": "drake_cafim.report/1",
        "verdict": ["none", "explained", "unexplained"][guess],
        "mismatch": {"detected": guess > 0, "p_value": 0.5, "locations": []},
        "data_mistakes": [],
        "explanation": explanation,
        "rivals": [],
        "parameters": [],
        "fit": {"train": {}, "held_out": {"nominal": {"nll": 1.0, "rmse": {}}, "corrected": {"nll": 0.5, "rmse": {}}}},
    }
    (out / "report.json").write_text(json.dumps(report))
    return 0


if __name__ == "__main__":
    sys.exit(main())
