"""The notebooks that take longest, which run beside the others."""

import pytest
from documents import LONG, NOTEBOOKS
from processes import keeping_programs_of_jax

import notebooks


@pytest.mark.slow
@pytest.mark.parametrize("path", [x for x in NOTEBOOKS if x.stem in LONG], ids=lambda x: x.stem)
def test_notebook(path, tmp_path):
    """The cells assert their facts, and files go elsewhere.

    The outputs are kept: they are those of the site.
    """
    with keeping_programs_of_jax():
        notebooks.execute(path, tmp_path)
    assert notebooks.is_kept(path)
