"""Pages of HTML: one style, with all figures inside of the file."""

import base64
import html
from collections.abc import Sequence

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width"><title>{title}</title><style>
:root {{ color-scheme: light dark; --ink: #222; --page: #fff; --line: #ddd; }}
@media (prefers-color-scheme: dark) {{
  :root {{ --ink: #ececec; --page: #16181c; --line: #3a3e46; }}
}}
html {{ background: var(--page); }}
body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem;
  color: var(--ink); }}
img {{ max-width: 100%; background: #fff; border-radius: 4px; }}
table {{ border-collapse: collapse; font-size: 0.85rem; font-variant-numeric: tabular-nums; }}
th, td {{ padding: 0.2rem 0.7rem; border-bottom: 1px solid var(--line); text-align: right; }}
td {{ white-space: nowrap; }}
.wide {{ overflow-x: auto; }}
@media (max-width: 48em) {{ .wide img {{ max-width: none; width: 38rem; }} }}
th:nth-child(-n+{left}), td:nth-child(-n+{left}) {{ text-align: left; }}
tr.front td {{ font-weight: 600; }}
</style></head><body>
<h1>{title}</h1>
{body}
</body></html>
"""


def document(title: str, *parts: str, left: int = 1) -> str:
    """A page of HTML of `parts` in HTML; the first `left` columns of its tables are text."""
    return _PAGE.format(title=html.escape(title), body="\n".join(parts), left=left)


def heading(text: str) -> str:
    """A heading."""
    return f"<h2>{html.escape(text)}</h2>"


def paragraph(text: str) -> str:
    """A paragraph of plain text."""
    return f"<p>{html.escape(text)}</p>"


def bullets(items: Sequence[str]) -> str:
    """A list of plain texts."""
    return "<ul>\n" + "\n".join(f"<li>{html.escape(item)}</li>" for item in items) + "\n</ul>"


def table(
    header: Sequence[str], rows: Sequence[Sequence[str]], bold: Sequence[bool] | None = None
) -> str:
    """A table that scrolls where it is wider than the page; some rows in `bold`."""
    marked = [False] * len(rows) if bold is None else bold
    lines = ["<tr>" + "".join(f"<th>{html.escape(name)}</th>" for name in header) + "</tr>"]
    for row, is_bold in zip(rows, marked, strict=True):
        cells = "".join(f"<td>{html.escape(cell)}</td>" for cell in row)
        lines.append(f"<tr{' class=front' if is_bold else ''}>{cells}</tr>")
    return '<div class="wide"><table>\n' + "\n".join(lines) + "\n</table></div>"


def picture(png: bytes, words: str) -> str:
    """A picture, and the `words` for those who cannot see it. On a narrow screen it scrolls rather
    than shrinks.
    """
    content = base64.b64encode(png).decode()
    image = f'<img alt="{html.escape(words)}"\n  src="data:image/png;base64,{content}">'
    return f'<div class="wide">{image}</div>'
