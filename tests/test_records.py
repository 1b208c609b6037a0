"""Records of benchmarks as JSON, and the numbers that pages have from them."""

import json
import re

import nbformat
import pytest
import record
import records
import texts
import verified
from documents import BLOCK, NOTEBOOKS, PAGES, ROOT

FOLDER = ROOT / "benchmarks"
ROLE = re.compile(r"\{figure\}`([^`]+)`")
OPTION = re.compile(r"^:[\w-]+: .*$", re.MULTILINE)
TABLES = re.compile(r"^```\{figures\} (\w+)\n:tables: (.*)\n:columns: (.*)\n", re.MULTILINE)
# In pages measured numbers are from records. What is set, such as a tolerance, is code.
AMOUNT = (
    r"(?:[\d.]+|two|three|four|five|six|seven|eight|nine|ten|eleven|twelve|twenty|thirty|fifty"
    r"|half an|hundred|thousand)"
)
MEASURED = re.compile(
    r"\d(?:\.\d+)?e[-+]?\d+|(?<!frac)\d ?(?:µs|us|ms|s|min|h|%)(?!\w)"
    r"|cdot\s?10\^|10\^\{?[-\\\d]"
    rf"|{AMOUNT}\s(?:and a half\s)?(?:minutes?|hours?|times\s(?:as|less|more|the))\b"
    rf"|factor\sof\s{AMOUNT}"
)
# How many times as fast, in a sentence or in a cell of a table.
RATIO = re.compile(rf"{AMOUNT}\stimes\s(?:as|less|more)\b|\d\stimes\s\|")
EXCEPTIONS = {
    "README.md": ["save 12 % and 30 %"],  # numbers of the chapter, which it is quoted for
    # Limits: the tests hold the first, and who makes a release the second.
    "CONTRIBUTING.md": ["10 s of a processor", "ten minutes on two cores"],
    "docs/howto/export_to_control.md": ["ten times the highest"],  # the range of a plot
    "docs/background/multibody_dynamics_for_jax_users.md": ["a thousand times the steps"],  # h ω
}
RECORDS = sorted(path.stem for path in FOLDER.glob("*.json"))

pytestmark = pytest.mark.instant


@pytest.mark.parametrize("name", RECORDS)
def test_both_forms_say_the_same(name):
    """A text that is newer is read by `python benchmarks/texts.py NAME`."""
    made = records.record(name)
    text = texts.read((FOLDER / f"{name}.txt").read_text())
    assert (made["made"], made["tables"]) == (text["made"], text["tables"])
    assert list(made["ratios"]) == list(text["ratios"])
    assert made["commit"]


def test_what_pages_name_is_in_the_records():
    roles = [(page, path) for page, text in PAGES.items() for path in ROLE.findall(text)]
    assert len(roles) > 30
    assert all(records.figure(path) for _, path in roles)
    tables = [found for text in PAGES.values() for found in TABLES.findall(text)]
    for name, above, columns in tables:
        named = [[x.strip() for x in words.split("|")] for words in (above, columns)]
        assert records.rows_of(name, *named)


def typed(page: str) -> list[str]:
    """The measured numbers in the sentences of a page, but those of its records."""
    text = records.NAMED.sub("", BLOCK.sub("", OPTION.sub("", PAGES[page])))
    for sentence in EXCEPTIONS.get(page, []):
        assert sentence in text, page
        text = text.replace(sentence, "")
    return MEASURED.findall(re.sub(r"`[^`]*`", "", text))


@pytest.mark.parametrize("page", PAGES)
def test_no_measured_number_is_typed(page):
    assert typed(page) == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_no_ratio_is_typed_in_a_notebook(path):
    """Its cells measure what its text says, and pages have the records: none is typed between."""
    cells = nbformat.read(path, as_version=4).cells
    text = "\n".join(cell.source for cell in cells if cell.cell_type == "markdown")
    assert RATIO.findall(re.sub(r"`[^`]*`", "", text)) == []


def test_the_readme_has_the_numbers_of_the_records():
    """`python docs/extensions/records.py` writes them."""
    readme = PAGES["README.md"]
    assert len(records.NAMED.findall(readme)) >= 5
    assert records.written(readme) == readme


def test_numbers_of_the_readme_begin_no_line():
    """A line that begins with a comment ends its paragraph, and is no Markdown."""
    lines = PAGES["README.md"].splitlines()
    assert [line for line in lines if records.NAMED.match(line)] == []


def test_a_commit_that_git_does_not_know_has_no_age():
    assert records.changes("nothing") == "unknown"


@pytest.mark.parametrize(
    "words",
    [
        "takes 105 ms",
        "errs by 1.5e-4",
        r"by $2\\cdot10^{-4}$",
        "in 3 s",
        "by 80 % on",
        "five times as fast",
        "a factor of 2.6",
        "twenty times the tolerance",
        "half an hour",
    ],
)
def test_typed_numbers_are_seen(words):
    assert MEASURED.search(words)


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("nothing; a; b; c", "no record benchmarks/nothing.json"),
        ("reduction; four-bar, 5 s; local; ms", "0 rows begin with 'local'"),
        ("reduction; four-bar; table; ms", "2 tables begin with 'four-bar'"),
        ("reduction; four-bar, 5 s; table; mass", "0 columns begin with 'mass'"),
        ("reduction; four-bar, 5 s; table", "is no 'record; table; row; column'"),
    ],
)
def test_what_names_nothing_is_refused(path, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        records.figure(path)


def test_a_record_and_its_text():
    """Written as it is read again, empty cells and long names of ratios included."""
    rows = [["model", "r", "error [m]"], ["full", "", "1e-9"], ["galerkin", "4", "2e-4"]]
    ratios = {"a ratio whose name is so long that it takes two lines / the other": 2.0}
    section = record.Section("Some models:", rows, ratios, data={"full": {"digits": 9.0}})
    judged = record.judge("made_up", ratios, {})
    heading = "2026-01-02, a machine,\nits system."
    text = f"{heading}\n\n{section}\n\n{record.MEANING}\n\n{record.verdicts(judged)}\n"
    read = texts.read(text)
    assert read["tables"] == [{"text": "Some models:", "columns": rows[0], "rows": rows[1:]}]
    assert read["ratios"] == {name: {"value": 2.0, "floor": None} for name in ratios}
    as_json = json.loads(record.as_json(heading, "abc", [section], judged))
    assert as_json == {**read, "commit": "abc", "data": {"full": {"digits": 9.0}}}


def test_the_page_of_verification():
    """Each problem with its place in the summary, its source and its picture."""
    page = verified.text()
    data = records.record("verification")["data"]
    assert page.count("\n### ") == len(data) >= 40
    assert page.count("**Source:**") == page.count("**Met:**") == len(data)
    assert page.count("<svg") >= 40
    for name in data:
        assert f"[{name}](#{verified.anchor(name)})" in page
