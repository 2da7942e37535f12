"""The score of plans while the contact law is in doubt: information about the parameters, and about which law holds."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from drake_cafim.design.planner import Scored
from drake_cafim.design.scores import InformationScore
from drake_cafim.design.situation import Hypothesis, Situation
from drake_cafim.errors import InputError
from drake_cafim.sensitivity.model import Rollout
from drake_cafim.typing import Array

LEAST = 0.01
"""Laws of a lower probability do not count in plans."""


@dataclass(frozen=True)
class LawAveragedScore:
    """Σ_k p_k (ψ_k − J_k) + Σ_{k<l} p_k p_l (B_kl + B_lk), over the contact laws with probabilities p.

    ψ_k − J_k is the score under law k (`scores` by law, the scenario's own first). B_kl is the expected logarithm of
    the Bayes factor of k over l from the plan's measurements, k being true. As log odds, it is in nats, as ψ of the
    criterion logdet; it vanishes as the odds turn.
    """

    scores: Mapping[str, InformationScore]

    def __call__(self, situation: Situation, commands: Array) -> Scored:
        """Scores of commands (N, H, nu); the Fisher information is the scenario's own law's."""
        if not situation.hypotheses:
            raise InputError("the policy was made for several laws, and the situation has none")
        size, count = len(situation.theta), len(commands)
        total, fisher = np.zeros(count), np.zeros((count, size, size))
        rollouts: list[tuple[Hypothesis, Rollout]] = []
        counted = [each for each in situation.hypotheses if each.probability >= LEAST]
        share = sum(each.probability for each in counted)
        # the robot moves the same under all laws
        motion = self.scores[counted[0].law].model.motion(situation.robot_state, commands)
        for each in counted:
            score = self.scores[each.law]
            rollout = score.evaluator(motion, each.theta, each.touched)
            scored = score.of_rollout(rollout, each)
            total = total + each.probability / share * scored.scores
            rollouts.append((each, rollout))
            if each is situation.hypotheses[0]:
                fisher = scored.fisher
        noise_std = next(iter(self.scores.values())).model.noise_std
        for first, second in combinations(rollouts, 2):
            weight = first[0].probability * second[0].probability / share**2
            total = total + weight * 2.0 * expected_log_bayes_factor(first, second, noise_std)
        return Scored(np.asarray(total), fisher)


def expected_log_bayes_factor(
    first: tuple[Hypothesis, Rollout], second: tuple[Hypothesis, Rollout], noise_std: Array
) -> Array:
    """The mean (N,) of B_kl and B_lk of two laws, for each candidate of their rollouts, in nats.

    ½ rᵀ S⁻¹ r with r the difference of their predictions and S = Σ_y + G_k Σ_k G_kᵀ + G_l Σ_l G_lᵀ the covariance of
    what both leave open: what another value of their parameters explains tells no laws apart. For the white noise Σ_y
    the inverse is taken by the matrix inversion lemma, in the number of parameters.
    """
    scale = np.asarray(noise_std)[:, np.newaxis]
    difference = ((first[1].measurements - second[1].measurements) / noise_std).reshape(len(first[1].measurements), -1)
    columns = []
    for hypothesis, rollout in (first, second):
        slopes = (rollout.sensitivities / scale).reshape(*difference.shape, -1)
        columns.append(slopes @ _root(hypothesis.covariance))
    U = np.concatenate(columns, axis=-1)
    along = np.einsum("btm,bt->bm", U, difference)
    inner = np.eye(U.shape[-1]) + np.swapaxes(U, -1, -2) @ U
    explained = np.einsum("bm,bm->b", along, np.linalg.solve(inner, along[..., np.newaxis])[..., 0])
    return np.asarray(0.5 * np.maximum((difference**2).sum(axis=-1) - explained, 0.0))


def _root(covariance: Array) -> Array:
    """A square root (n, n) of a covariance that may be singular by rounding."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
