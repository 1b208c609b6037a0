"""A scene as a few lines of SVG, for a page that has dozens of them."""

import numpy as np

import romjax as rj
from romjax.assembly.outlines import outlines
from romjax.plot.mechanism import bounds, framed, projected

SIZE = 200.0  # of the longer side, in units of the picture
NEAR = 0.4  # units, within which a point is left out


def svg(scene: rj.Scene) -> str:
    """The start of a scene, in space as seen from one side; `body` and `sign` are its classes."""
    start = np.concatenate([np.asarray(body.start()[0]) for body in scene.bodies])
    drawn = [o for o in projected(outlines(scene, 0.0, start[None])) if o.points.shape[1]]
    low, high = framed(bounds(drawn))
    scale = SIZE / np.max(high - low)
    width, height = scale * (high - low)
    paths = []
    for outline in drawn:
        points = (outline.points[0] - low) * [scale, -scale] + [0.0, height]
        kind = "body" if outline.style == "body" else "sign"
        paths.append(f'<path class="{kind}" d="{path(points)}"/>')
    box = f"0 0 {width:.0f} {height:.0f}"
    return f'<svg class="problem" viewBox="{box}" role="img">{"".join(paths)}</svg>'


def path(points: np.ndarray) -> str:
    """A polyline; what is not finite, or far outside, is a gap."""
    words, last = [], None
    for point in points:
        if not np.all(np.isfinite(point)) or np.max(np.abs(point)) > 10 * SIZE:
            last = None
            continue
        if last is not None and np.max(np.abs(point - last)) < NEAR:
            continue
        words.append(f"{'M' if last is None else 'L'}{point[0]:.1f} {point[1]:.1f}")
        last = point
    return "".join(words)
