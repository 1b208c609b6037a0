"""Keys of parts that may share their labels."""

import itertools
from collections.abc import Sequence


def unique(labels: Sequence[str]) -> list[str]:
    """The labels as keys: where several parts have one label, all of them are numbered, from 1,
    but for numbers with which the key would be the label of another part.
    """
    keys, taken = [], set(labels)
    for label in labels:
        key = label
        if labels.count(label) > 1:
            numbered = (f"{label} {number}" for number in itertools.count(1))
            key = next(name for name in numbered if name not in taken)
            taken.add(key)
        keys.append(key)
    return keys
