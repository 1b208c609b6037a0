"""The benchmark of batches on a GPU, where the CPU stands for it, and its table."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent / "benchmarks"


@pytest.fixture
def benchmark_of_gpu(monkeypatch):
    """The command as a module."""
    monkeypatch.syspath_prepend(FOLDER)
    import gpu

    yield gpu
    for name in (path.stem for path in FOLDER.glob("*.py")):
        sys.modules.pop(name, None)


@pytest.mark.instant
def test_what_no_time_is_left_for_is_named(benchmark_of_gpu, tmp_path):
    benchmark_of_gpu.main(["--out", str(tmp_path), "--budget", "0"])
    text = (tmp_path / "gpu.txt").read_text()
    assert "cart, adaptive: no time to begin" in text
    assert "chain 8, graphs: no time to begin" in text
    assert "cart, r = 3, sweep: no time to begin" in text
    assert "hinges 32, cpu: no time to begin" in text


@pytest.mark.instant
def test_the_table_of_findings(benchmark_of_gpu, tmp_path):
    """Rates, errors and ratios are those of the numbers; what was left out once may come later."""
    run = {"name": "chain 8, r = 8", "control": "adaptive", "steps": 20, "flags": 0}
    wide = {**run, "lanes": 1_000_000, "compiled": 3.0, "s": 2.0, "q": [[1.0, 2.0], [3.0, 4.5]]}
    found = [
        {"device": "NVIDIA H100 80GB HBM3"},
        {**run, "lanes": 256, "cpu": True, "s": 0.5, "q": [[1.0, 2.0], [3.0, 4.0]]},
        {**run, "truth": True, "q": [[1.0, 2.25]]},
        {**run, "lanes": 1_000_000, "left": "no time to compile"},
        *({**run, "lanes": n, "left": "no time to compile"} for n in (1000, 100)),
        wide,
        {**run, "started": [40, 60]},
        {"sweep": 0, "name": "chain 8, r = 8", "lanes": 1000, "s": 0.5},
    ]
    (tmp_path / "gpu.jsonl").write_text("".join(json.dumps(x) + "\n" for x in found))
    benchmark_of_gpu.main(["--out", str(tmp_path), "--keep", "--what", "cpu", "--budget", "0"])
    text = (tmp_path / "gpu.txt").read_text()
    rows = [" ".join(line.split()) for line in text.splitlines()]
    assert "chain 8, r = 8, adaptive 1e6 500000 20 100 2 3 2e-01 5e-01" in rows
    assert "chain 8, r = 8, adaptive 512 977" in rows
    assert "chain 8, r = 8 1000 256 2000" in rows
    assert "chain 8, r = 8, adaptive, 100, 1000 lanes: no time to compile" in rows
    assert "cart, cpu: no time to begin" in rows
    assert "chain 8, r = 8, cpu: no time to begin" not in rows
    assert max(map(len, text[text.index("One second") :].splitlines())) <= 80


@pytest.mark.exhaustive
def test_a_pendulum(tmp_path):
    """A bar on a hinge, one and eight at once: the same numbers in all processes."""
    what = ["--cases", "7", "--lanes", "8", "1", "--what", "adaptive", "cpu", "--beside", "1"]
    words = [sys.executable, FOLDER / "gpu.py", "--out", tmp_path, "--budget", "600", *what]
    subprocess.run(words, check=True, capture_output=True)
    lines = (tmp_path / "gpu.jsonl").read_text().splitlines()
    found = [x for x in map(json.loads, lines) if "q" in x]
    one, eight = (next(x for x in found if "compiled" in x and x["lanes"] == n) for n in (1, 8))
    (truth,) = (x for x in found if "truth" in x)
    assert eight["q"][0] == pytest.approx(one["q"][0], abs=1e-9)
    assert len(eight["q"]) == len(truth["q"]) == 8
    for states, exact in zip(eight["q"], truth["q"], strict=True):
        assert states == pytest.approx(exact, abs=1e-6)
    assert "Left out" not in (tmp_path / "gpu.txt").read_text()
