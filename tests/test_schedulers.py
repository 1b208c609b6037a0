"""A sweep whose processes a scheduler starts, which do not know of each other."""

import importlib.util
import os

import numpy as np
import pytest
from groups import in_groups
from processes import in_a_process

# Two oscillators a lane, in chunks that the workers share by a folder.
SWEEP = """
import os
import jax
jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import romjax as rj

def mass(q):
    return jnp.eye(1)

def force(t, q, v, stiffness):
    return -stiffness * q

def swing(point):
    system = rj.CustomSystem(
        mass=mass, force=jax.tree_util.Partial(force, stiffness=point["stiffness"]),
        q0=jnp.ones(1), v0=jnp.zeros(1),
    )
    return rj.simulate(system, jnp.linspace(0.0, 1.0, 5), audit=False, throw=False)

def shared(folder=None):
    stiffness = {"stiffness": jnp.linspace(1.0, 90.0, 96)}
    folder = folder or os.environ["FOLDER"]
    return rj.sweep(lambda p: swing(p).q, stiffness, chunk=8, path=folder).values
"""
SCHEDULERS = {
    "joblib": """
import joblib
found = joblib.Parallel(n_jobs=2)(joblib.delayed(shared)() for _ in range(2))
""",
    "distributed": """
import dask.distributed
dask.config.set({"distributed.worker.profile.enabled": False})
client = dask.distributed.Client(n_workers=2, threads_per_worker=1, dashboard_address=None)
found = client.gather([client.submit(shared, pure=False) for _ in range(2)])
client.shutdown()
""",
    "ray": """
import ray
found = ray.get([ray.remote(shared).remote() for _ in range(2)])
""",
}
ASKED = """
from shared_sweep import shared
import numpy as np
if __name__ == "__main__":
{scheduler}
    alone = shared(os.environ["ALONE"])
    print(all(np.array_equal(one, alone) for one in found), alone.shape)
"""


@pytest.mark.parametrize("name", in_groups(SCHEDULERS, slow=["joblib"]))
def test_a_sweep_by_a_scheduler(name, tmp_path):
    """Its workers return the same numbers to the bit as one process does."""
    if importlib.util.find_spec(name) is None:
        pytest.skip(f"{name} is not installed")
    (tmp_path / "shared_sweep.py").write_text(SWEEP)
    indented = "".join(f"    {line}\n" for line in SCHEDULERS[name].strip().splitlines())
    said = in_a_process(
        ASKED.format(scheduler=indented),
        FOLDER=str(tmp_path / "shared"),
        ALONE=str(tmp_path / "alone"),
        PYTHONPATH=os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]),
    )
    assert said[-1] == "True (96, 5, 1)"
    chunks = sorted((tmp_path / "shared").glob("chunk-*.npz"))
    assert len(chunks) == 12
    for chunk in chunks:
        other = tmp_path / "alone" / chunk.name
        with np.load(chunk) as one, np.load(other) as two:
            assert np.array_equal(one["arr_0"], two["arr_0"])
