"""Figures as the content of files."""

import io
from typing import Any


def png(figure: Any, dpi: int) -> bytes:
    """A figure of matplotlib as the content of a PNG file."""
    # Here, since it takes long to load, and most commands draw nothing.
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    content = io.BytesIO()
    figure.set_dpi(dpi)
    # `savefig` draws a figure that lays itself out twice.
    FigureCanvasAgg(figure).print_png(content)
    return content.getvalue()
