"""What a release consists of agrees with itself, and the checks before a commit are those of CI."""

import re
import shutil
import subprocess
import sys
import tomllib

import pytest
import yaml
from documents import ROOT

import romjax as rj

CHANGES = (ROOT / "CHANGELOG.md").read_text()
# The README's pictures, by the scripts that draw them, and how large they may be [bytes].
LARGEST = {"cart_pendulum.gif": 300_000, "what_accuracy_costs.png": 100_000}
HOOKS = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]


@pytest.mark.instant
def test_version():
    """Of the package, of the citation, and of the first heading of the changes."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == rj.__version__
    assert re.findall(r"^## (\S+)", CHANGES, re.MULTILINE)[0] == rj.__version__


@pytest.mark.instant
def test_the_extra_all_is_what_any_function_may_ask_for():
    """Each extra that a message names, and none beside."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    (named,) = project["optional-dependencies"]["all"]
    sources = "".join(path.read_text() for path in (ROOT / "romjax").rglob("*.py"))
    asked = {name for name in project["optional-dependencies"] if f'"{name}")' in sources}
    asked |= {name for name in project["optional-dependencies"] if f'"{name}", ' in sources}
    asked |= set(re.findall(r"romjax\[(\w+)\]", sources))
    assert set(re.fullmatch(r"romjax\[(.*)\]", named)[1].split(",")) == asked


@pytest.mark.instant
def test_commits_are_checked_as_ci_does():
    script = (ROOT / ".ci" / "run").read_text().splitlines()
    checks = [hook["entry"].removesuffix(" --force-exclude") for hook in HOOKS]
    assert len(checks) >= 3
    for check in checks:
        assert any(line.startswith(f".venv/bin/{check}") for line in script), check


@pytest.mark.slow
def test_pre_commit_knows_the_hooks(tmp_path):
    """It takes the file, and puts itself before the commits of a repository."""
    pytest.importorskip("pre_commit")
    shutil.copy(ROOT / ".pre-commit-config.yaml", tmp_path)
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    for arguments in (["validate-config"], ["install"]):
        subprocess.run([sys.executable, "-m", "pre_commit", *arguments], cwd=tmp_path, check=True)
    assert (tmp_path / ".git" / "hooks" / "pre-commit").exists()


@pytest.mark.instant
def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 120
    for name, size in LARGEST.items():
        assert (ROOT / "docs" / "images" / name).stat().st_size < size


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", LARGEST)
def test_pictures_are_drawn(name, tmp_path):
    """By the script beside each; they fit the README."""
    script = (ROOT / "docs" / "images" / name).with_suffix(".py")
    subprocess.run([sys.executable, "-W", "error", script, tmp_path / name], check=True)
    assert 0 < (tmp_path / name).stat().st_size < LARGEST[name]
