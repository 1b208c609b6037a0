"""The site: `sphinx-build -W docs build/site` makes all of it, from nothing.

What takes long is kept in `build/executed`, in a folder for each state of the package: the
notebooks' outputs, which the tests put there too, and the moving pictures of the gallery.
"""

import sys
import zlib
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "extensions")]

import executed  # noqa: E402

import notebooks  # noqa: E402
import romjax  # noqa: E402

project = "romjax"
author = "romjax developers"
project_copyright = author
version = release = romjax.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.intersphinx",
    "sphinx.ext.mathjax",
    "sphinx-mathjax-offline",
    "sphinx_copybutton",
    "sphinx_design",
    "api",
    "figures",
    "gallery",
    "markdown_docstrings",
    "pictures",
    "verbs",
    "verified",
]
exclude_patterns = ["extensions", "reference/api_introduction.md"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "amsmath", "attrs_inline"]
myst_heading_anchors = 4
smartquotes = False
copybutton_prompt_text = "$ "
copybutton_only_copy_prompt_lines = True

notebooks.copy(HERE.parent / "notebooks", HERE / "tutorials" / "notebooks")
nb_execution_mode = "cache"
nb_execution_cache_path = str(notebooks.CACHE)
nb_execution_in_temp = True
nb_execution_timeout = notebooks.TIMEOUT
nb_execution_raise_on_error = True
nb_merge_streams = True
nb_output_stderr = "remove"  # warnings have paths of the machine that built the site

autodoc_inherit_docstrings = False
autodoc_member_order = "bysource"
python_maximum_signature_line_length = 72
add_module_names = False
python_use_unqualified_type_names = True

# Where the network is out of reach, names of others are text instead of links.
without_network = executed.FOLDER / "none.inv"
without_network.parent.mkdir(parents=True, exist_ok=True)
header = b"# Sphinx inventory version 2\n# Project: none\n# Version: 0\n# zlib\n"
without_network.write_bytes(header + zlib.compress(b""))
intersphinx_mapping = {
    name: (url, (None, str(without_network)))
    for name, url in {
        "jax": "https://docs.jax.dev/en/latest/",
        "diffrax": "https://docs.kidger.site/diffrax/",
        "equinox": "https://docs.kidger.site/equinox/",
    }.items()
}
intersphinx_timeout = 10

html_theme = "furo"
html_title = f"romjax {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]


def setup(app: Sphinx) -> None:
    # All at once, since MyST-NB executes one notebook after the other.
    app.connect("builder-inited", lambda app: notebooks.execute_missing(HERE.parent / "notebooks"))
