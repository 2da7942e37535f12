"""Sealed answers: a salted hash published before the diagnosis and checked when the answer is opened."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass


def canonical(truth: dict[str, object]) -> bytes:
    """One byte string for one truth."""
    return json.dumps(truth, sort_keys=True, separators=(",", ":"), default=float).encode()


@dataclass(frozen=True)
class Seal:
    """A truth with its salt; only `digest` is told before the diagnosis."""

    truth: dict[str, object]
    salt: str

    @classmethod
    def close(cls, truth: dict[str, object]) -> Seal:
        """Seals a copy, so that nothing that is changed later can change the answer."""
        return cls(json.loads(canonical(truth)), os.urandom(16).hex())

    @property
    def digest(self) -> str:
        return hashlib.sha256(bytes.fromhex(self.salt) + canonical(self.truth)).hexdigest()

    def verify(self, digest: str) -> bool:
        """Whether this is what was sealed under `digest`."""
        return self.digest == digest


def fresh_seed() -> str:
    """A seed from the system's entropy, 0x-prefixed."""
    return "0x" + os.urandom(16).hex()


def case_seed(master: str, slot: int) -> int:
    """The seed of a case: not to be guessed from the seeds of others."""
    return int.from_bytes(hashlib.sha256(f"{master}:{slot}".encode()).digest()[:16], "big")
