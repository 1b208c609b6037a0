"""How models look in all figures and pages: colours, dashes and widths."""

# Okabe and Ito's palette, which colour-blind readers can tell apart; the reference in black, then
# in an order that alternates dark and light, for print in grey.
COLOURS = ("#000000", "#D55E00", "#56B4E9", "#009E73", "#CC79A7", "#0072B2", "#E69F00")
# Lengths of strokes and gaps, in widths of the line.
STROKES: tuple[tuple[float, ...], ...] = (
    (),
    (5, 2),
    (1.5, 1.5),
    (7, 2, 1.5, 2),
    (3, 3),
    (9, 3),
    (6.4, 1.6, 1, 1.6),
)
# The direction from which space is seen at first: azimuth against the x axis, and elevation [rad].
View = tuple[float, float]
VIEW: View = (-0.9, 0.42)
# Widths of the reference, and of what is drawn over it [pt].
WIDTHS = (2.0, 1.4)
