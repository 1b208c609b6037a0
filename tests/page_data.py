"""What a moving page is told, decoded as its script does it."""

import base64
import json
import re

import numpy as np

from romjax.assembly.outlines import MovingOutline

DATA = re.compile(r'<script type="application/json" id="data">(.*?)</script>', re.DOTALL)


def data(page: str) -> dict:
    """What the page is told."""
    (found,) = DATA.findall(page)
    return json.loads(found)


def integers(text: str) -> list[int]:
    """As the page reads them: seven bits in each byte, the lowest first, the sign in the lowest."""
    numbers, value, place = [], 0, 0
    for byte in base64.b64decode(text):
        value |= (byte & 127) << place
        place += 7
        if byte < 128:
            numbers.append(-(value + 1) // 2 if value % 2 else value // 2)
            value = place = 0
    return numbers


def decode(block: dict, frames: int) -> np.ndarray:
    """(frames, columns), as the page sums them up."""
    base = np.array(integers(block["base"]), float)
    rank = len(block["reach"])
    shapes = np.reshape(integers(block["shapes"]), (rank, len(base)))
    weights = np.reshape(integers(block["weights"]), (rank, frames if rank else 0))
    weights = np.cumsum(np.cumsum(weights, axis=1), axis=1) / np.reshape(block["reach"], (-1, 1))
    moved = weights.T @ shapes if rank else 0
    return block["quantum"] * (np.tile(base, (frames, 1)) + moved)


def decoded(told: dict, model: int, scale: float = 1.0) -> list[MovingOutline]:
    """The outlines of a page."""
    found, d = [], told["dimension"]
    for part in told["models"][model]["parts"]:
        values = decode(part["move"], told["frames"])
        if part["bend"]:
            values = values + scale * decode(part["bend"], told["frames"])
        first = 0
        for own in part["outlines"]:
            points = values[:, first : first + d * own["points"]]
            first += d * own["points"]
            points = points.reshape(len(values), -1, d)
            found.append(MovingOutline(part["name"], points, own["style"], own["endless"]))
        assert first == values.shape[1]
    return found


def apart(found: list[MovingOutline], wanted: list[MovingOutline]) -> float:
    """The largest distance of points, in pixels of a picture whose diagonal has a thousand."""
    corner = np.concatenate(
        [o.points.reshape(-1, o.points.shape[2]) for o in wanted if not o.endless]
    )
    diagonal = np.linalg.norm(np.ptp(corner, axis=0))
    for one, other in zip(found, wanted, strict=True):
        assert (one.part, one.style, one.endless) == (other.part, other.style, other.endless)
    errors = [
        np.max(np.abs(one.points - other.points)) for one, other in zip(found, wanted, strict=True)
    ]
    return 1000 * max(errors) / diagonal
