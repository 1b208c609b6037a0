"""Moving points as short text: few shapes, how much of each there is in time, as small integers."""

import base64
from typing import Any

import numpy as np
from jaxtyping import Float, Int

# The largest error of what is left out, in quanta; rounding adds half a quantum for the mean and
# up to one for each shape.
LEFT_OUT = 0.5


def encode(values: Float[np.ndarray, "frames columns"], quantum: float) -> dict[str, Any]:
    """`values` (frames, columns) as base + Σ weight_k / reach_k · shape_k, in units of `quantum`.

    Each shape is what the others leave of the frame where they leave most, as in an orthogonal
    decomposition with pivots: a rigid outline in the plane has at most four, whatever the number of
    its points, a beam two more for each mode, and what rests has none.
    All are integers; weights change smoothly, so that their second differences are small. The
    decoder is in player/decode.js.
    """
    scaled = np.asarray(values, float) / quantum
    mean = np.mean(scaled, axis=0)
    left = scaled - mean[None]
    rows, weights, reaches = [], [], []
    for _ in range(min(left.shape)):
        if np.max(np.abs(left), initial=0.0) <= LEFT_OUT:
            break
        # By einsum: libraries hand small products to threads, a hundred times slower when busy.
        squares = np.einsum("ij,ij->i", left, left)
        shape = left[np.argmax(squares)]
        course = np.einsum("ij,j->i", left, shape) / np.max(squares)
        left = left - course[:, None] * shape[None]
        rows.append(np.rint(shape).astype(np.int64))
        reaches.append(max(1, int(np.max(np.abs(rows[-1])))))
        weights.append(np.rint(course * reaches[-1]).astype(np.int64))
    return {
        "quantum": quantum,
        "base": text(np.rint(mean).astype(np.int64)),
        "reach": reaches,
        "shapes": text(np.array(rows, np.int64)),
        "weights": "" if not weights else text(differences(np.array(weights))),
    }


def differences(rows: Int[np.ndarray, "rows frames"]) -> Int[np.ndarray, "rows frames"]:
    """Second differences along each row, from two zeros on; two cumulative sums undo them."""
    return np.diff(np.pad(rows, ((0, 0), (2, 0))), 2)


def text(numbers: Int[np.ndarray, "*shape"]) -> str:
    """Integers in as many bytes as they need: seven bits each, the sign lowest, in base64."""
    flat = np.asarray(numbers, np.int64).ravel()
    unsigned = ((flat << 1) ^ (flat >> 63)).astype(np.uint64)
    steps = np.arange(0, 63, 7, dtype=np.uint64)
    parts = unsigned[:, None] >> steps[None]
    more = (parts >> np.uint64(7)) > 0
    used = np.concatenate([np.ones((len(flat), 1), bool), more[:, :-1]], axis=1)
    content = ((parts & np.uint64(127)) | (more * np.uint64(128))).astype(np.uint8)
    return base64.b64encode(content[used].tobytes()).decode()
