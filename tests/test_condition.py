"""Sentences on the condition under which a mismatch shows."""

import re

import numpy as np
import pytest

from drake_cafim.diagnosis.joints.mismatch_conditions import Seen, condition

TIME = 0.03 * np.arange(400)
V = np.sin(2.0 * TIME)
Q = -np.cos(2.0 * TIME)
U = 3.0 * np.sin(5.1 * TIME + 1.0)


def _seen(size: np.ndarray) -> Seen:
    rng = np.random.default_rng(0)
    names = ["a"] * 200 + ["b"] * 200
    return Seen(size * rng.choice([-1.0, 1.0], 400) + rng.normal(size=400), TIME, TIME + 0.06, names, "elbow", Q, V, U)


@pytest.mark.parametrize(
    ("size", "words"),
    [
        (np.where(np.abs(V) < 0.04, 30.0, 0.0), "at reversals of v.elbow"),
        (20.0 * np.abs(U), "grows with |u.elbow|"),
        (20.0 * np.abs(V), "grows with |v.elbow|"),
        (np.where((TIME > 7.0) & (TIME < 7.5), 20.0, 0.0), "only in 7.0–7.5 s of b"),
        (np.where(Q < -0.9, 20.0, 0.0), "only below q.elbow = -0.9"),
        (np.where(Q > 0.9, 20.0, 0.0), "only above q.elbow = 0.9"),
        (np.full(400, 9.0), ""),
    ],
)
def test_condition(size: np.ndarray, words: str) -> None:
    told = condition(_seen(size))
    number = r"-?[0-9]+(?:\.[0-9]+)?"
    assert re.sub(number, "#", told) == re.sub(number, "#", words)
    found, expected = ([float(x) for x in re.findall(number, text.replace("|", ""))] for text in (told, words))
    np.testing.assert_allclose(found, expected, atol=0.1)
