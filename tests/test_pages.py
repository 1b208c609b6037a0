"""The pages of the site: their code runs, their links lead somewhere, and every name has one."""

import re
from pathlib import PurePosixPath

import api
import gallery
import nbformat
import pytest
import scripts
from documents import BLOCK, GENERATED, PAGES, ROOT, blocks
from documents import NOTEBOOKS as NOTEBOOK_FILES
from names import public
from processes import keeping_programs_of_jax

import romjax as rj
from romjax.gallery import EXAMPLES

# The blocks of Python of a page are one script, without those that the README has too and runs.
ONCE = {*blocks(PAGES["README.md"], "python")}
SCRIPTS = {
    name: "\n".join(own for own in code if name == "README.md" or own not in ONCE)
    for name, text in PAGES.items()
    if (code := blocks(text, "python"))
}
LINK = re.compile(r"\]\((?!https?:|#|mailto:)([^)#\s]+)")
CARD = re.compile(r"^:link: (\S+)$", re.MULTILINE)
HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)
FIND = "docs/howto/find.md"
TASK = re.compile(r"^\| .* \| \[.*\]\(([^)#]+)#?([^)]*)\) \|$", re.MULTILINE)
NOTEBOOKS = "docs/tutorials/notebooks/"
# What they say is a list of facts, or commands that other tests run.
WITHOUT_CODE = {
    "docs/reference/benchmarks.md",
    "docs/reference/cite.md",
    "docs/reference/faq.md",
    "docs/reference/limits.md",
    "docs/reference/stability.md",
    "docs/start/what_it_is_for.md",
    "docs/howto/stabilization.md",
}
TUTORIALS = "docs/tutorials/index.md"
WITHOUT_BODIES = {"natural_frequencies"}  # three coupled masses, given by matrices
# Pages that another one includes.
PARTS = {"docs/reference/api_introduction.md"}


@pytest.fixture(scope="module")
def process():
    with keeping_programs_of_jax(), scripts.processes() as pool:
        yield pool


@pytest.mark.slow
@pytest.mark.parametrize("name", SCRIPTS)
def test_code_runs(process, tmp_path, name):
    """From top to bottom, without a warning, where nothing else does."""
    process.submit(scripts.run, SCRIPTS[name], str(tmp_path)).result(timeout=600)


def target_of(page: str, link: str) -> PurePosixPath:
    """The file that a link of a page names, from the root of the project."""
    target = PurePosixPath(page).parent
    for part in PurePosixPath(link).parts:
        target = target.parent if part == ".." else target / part
    return target


def leads_somewhere(page: str, link: str) -> bool:
    """Whether there is a file, or the build of the site writes it."""
    target = target_of(page, link)
    name = str(target)
    if name.startswith(NOTEBOOKS):
        return (ROOT / "notebooks" / target.name).exists()
    if name.startswith("docs/reference/api/"):
        return target.stem in {"index", *map(api.page, api.everything())}
    return name in GENERATED or (ROOT / name).exists()


@pytest.mark.instant
def test_links():
    links = [(page, link) for page, text in PAGES.items() for link in LINK.findall(text)]
    assert len(links) > 5
    assert [(page, link) for page, link in links if not leads_somewhere(page, link)] == []


@pytest.mark.instant
@pytest.mark.parametrize("link", ["nowhere.md", "../notebooks/none.ipynb", "reference/api/no.md"])
def test_links_to_nothing_are_seen(link):
    assert not leads_somewhere("docs/index.md", link)


def leads_to(page: str) -> set[str]:
    """The pages that a page has links, cards, or entries in the navigation for."""
    text = PAGES.get(page, "")
    trees = "\n".join(blocks(text, "{toctree}")).splitlines()
    named = [*CARD.findall(text), *(line for line in trees if line and line[0] != ":")]
    return {
        str(target_of(page, link)) for link in [*LINK.findall(text), *(f"{x}.md" for x in named)]
    }


@pytest.mark.instant
def test_every_page_is_two_clicks_from_the_start():
    near = {"docs/index.md"}
    for _ in range(2):
        near = near.union(*map(leads_to, near))
    assert {page for page in PAGES if page.startswith("docs/")} - PARTS - near == set()


def anchors(page: str) -> set[str]:
    """The names by which links lead to the headings of a page."""
    titles = HEADING.findall(BLOCK.sub("", PAGES[page]))
    return {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.instant
def test_tasks_are_two_clicks_from_the_start():
    """From the start page to the list of tasks, and from there to a page, or to a heading on it;
    one whose code is run, or a notebook, but for what is refused and what is generated.
    """
    assert FIND in leads_to("docs/index.md")
    tasks = TASK.findall(PAGES[FIND])
    heads = PAGES[FIND].count("\n|---")
    assert len(tasks) == PAGES[FIND].count("\n|") - 2 * heads >= 90
    wrong = [link for link, _ in tasks if not leads_somewhere(FIND, link)]
    for link, anchor in tasks:
        if anchor and anchor not in anchors(str(target_of(FIND, link))):
            wrong.append(f"{link}#{anchor}")
    assert wrong == []
    pages = {str(target_of(FIND, link)) for link, _ in tasks}
    silent = {page for page in pages if page not in SCRIPTS and not page.startswith(NOTEBOOKS)}
    assert silent - set(GENERATED) <= WITHOUT_CODE


@pytest.mark.instant
def test_the_page_of_the_gallery():
    """Each scene with its moving picture, its fact, what it teaches and takes, and its file."""
    page, name = gallery.page(), "docs/reference/gallery.md"
    scenes = dict(re.findall(r"^## (\S+)\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL))
    assert list(scenes) == [example.name for example in EXAMPLES]
    for scene, text in scenes.items():
        assert f'src="../gallery/{scene}.html"' in text
        told = re.findall(r"^- \*\*(.*?)\*\* \S", text, re.MULTILINE)
        assert told == ["What holds.", "What you learn.", "What it takes.", "Files."]
        (file,) = re.findall(r"{download}`\S+ <(\S+)>`", text)
        assert (ROOT / target_of(name, file)).exists()
        assert f"$ romjax run {scene}\n" in text
    assert [link for link in LINK.findall(page) if not leads_somewhere(name, link)] == []
    assert page.count(" ms for a run after it") >= 20


@pytest.mark.instant
def test_the_tutorials_are_pictures():
    """Each notebook has a card with a picture, and shows its mechanism moving, if it has bodies."""
    cards = dict(
        re.findall(r":link: /tutorials/notebooks/(\S+)\n.*\n:img-top: (\S+)", PAGES[TUTORIALS])
    )
    assert cards == {path.stem: f"pictures/{path.stem}.png" for path in NOTEBOOK_FILES}
    moving = {
        path.stem
        for path in NOTEBOOK_FILES
        for cell in nbformat.read(path, as_version=4).cells
        if cell.cell_type == "code" and "animate(" in cell.source.splitlines()[-1]
    }
    assert {path.stem for path in NOTEBOOK_FILES} - moving == WITHOUT_BODIES


def is_public(part: object) -> bool:
    return str(getattr(part, "__module__", "")).startswith("romjax.")


@pytest.mark.instant
def test_every_public_name_has_a_page():
    """Those of `romjax`, of `romjax.spatial` and all scenes of the gallery."""
    exported = {f"romjax.{name}" for name in public() if "." not in name}
    exported |= {f"romjax.spatial.{name}" for name, x in vars(rj.spatial).items() if is_public(x)}
    scenes = {f"romjax.gallery.{example.make.__name__}" for example in EXAMPLES}
    assert exported | scenes <= set(api.everything())
    assert {api.page(name) for name in api.everything()} == set(api.pages())
