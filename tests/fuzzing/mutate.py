"""Damage to bytes, and to trees of mappings, lists and values, by a random number generator."""

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np

WORDS = [b"\x00" * 4, b"\xff" * 4, b"\xff" * 8, b"\x7f\xff\xff\xff", b"\x00\x00\x00\x80", (2**31).to_bytes(8, "little")]
WORDS += [b"nan", b"inf", b"-1", b"1e999", b"\x80", b"\xc3\x28", b'"', b"\n", b",", b"/", b"<", b"\x00", b"9" * 400]
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 10**400, -(2**63), 1.5, -1e-300, 1e308, float("nan"), float("inf")),
    *("", "x", "a\nb\x00c", "é" * 300, "1e-3", "null", "package://x/y", "../../..", "world", "!Rpy"),
    *([], {}, [[]], [None], {"": None}, {"a": {"b": {"c": 1}}}, {1: 2}, {None: 3}, [1, 2, 3], [1e9] * 10, "x" * 20000),
)


def damage_bytes(data: bytes, rng: np.random.Generator, others: Sequence[bytes] = ()) -> bytes:
    """The bytes with one to four changes: flips, special numbers, cuts, repeats, pieces of another file."""
    whole = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        kind, where = int(rng.integers(9)), int(rng.integers(max(len(whole), 1)))
        length = int(rng.integers(1, 1 + min(200, max(len(whole), 1))))
        if kind == 0:
            del whole[where:]
        elif kind == 1:
            del whole[where : where + length]
        elif kind == 2:
            whole[where:where] = whole[where : where + length]
        elif kind == 3 and others:
            other = others[int(rng.integers(len(others)))]
            start = int(rng.integers(max(len(other), 1)))
            whole[where : where + length] = other[start : start + length]
        elif kind == 4:
            word = WORDS[int(rng.integers(len(WORDS)))]
            whole[where : where + len(word)] = word
        elif kind == 5:
            whole[where:where] = WORDS[int(rng.integers(len(WORDS)))]
        elif whole:
            for at in rng.integers(len(whole), size=int(rng.integers(1, 6))):
                whole[at] = int(rng.integers(256)) if kind < 8 else whole[at] ^ (1 << int(rng.integers(8)))
    return bytes(whole)


def damage_tree(tree: Any, rng: np.random.Generator) -> Any:
    """A copy of the tree with one to three nodes replaced, removed, renamed, repeated or swapped."""
    tree = copy.deepcopy(tree)
    for _ in range(int(rng.integers(1, 4))):
        places = [place for place in _places(tree) if place[1] is not None]
        if not places:
            return VALUES[int(rng.integers(len(VALUES)))]
        holder, key = places[int(rng.integers(len(places)))]
        kind = int(rng.integers(12))
        other_holder, other_key = places[int(rng.integers(len(places)))]
        if kind > 5:
            holder[key] = _likely(holder[key], [h[k] for h, k in places], rng)
        elif kind <= 2:
            holder[key] = copy.deepcopy(VALUES[int(rng.integers(len(VALUES)))])
        elif kind == 3:
            del holder[key]
        elif kind == 4:
            holder[key] = copy.deepcopy(other_holder[other_key])
        elif isinstance(holder, dict):
            name = VALUES[int(rng.integers(len(VALUES)))]
            holder[name if isinstance(name, str | int | None) else str(other_key)] = holder.pop(key)
        else:
            holder.insert(key, copy.deepcopy(holder[key]))
    return tree


def _likely(value: Any, others: list[Any], rng: np.random.Generator) -> Any:
    """Another value of the same type: a number of another size, a text of the same tree."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (
            float(min(max(value, -1e300), 1e300) or 1.0)
            * float(rng.choice([-1.0, 1.0]))
            * 10.0 ** int(rng.integers(-9, 9))
        )
    same = [other for other in others if type(other) is type(value)]
    return copy.deepcopy(same[int(rng.integers(len(same)))])


def _places(tree: Any) -> list[tuple[Any, Any]]:
    """Each (holder, key) of the tree."""
    found: list[tuple[Any, Any]] = []
    rest = [tree]
    while rest:
        holder = rest.pop()
        items = holder.items() if isinstance(holder, dict) else enumerate(holder) if isinstance(holder, list) else ()
        for key, value in items:
            found.append((holder, key))
            rest.append(value)
    return found
