"""`mems-impact docs` finds the page on a word, built or not."""

import re
from pathlib import Path

import pytest

import mems_impact as mi
from mems_impact.cli import docs


@pytest.fixture
def site(tmp_path):
    (tmp_path / "reference").mkdir()
    for name in (
        "index",
        "maps",
        "guide",
        "figures",
        "orbits",
        "stability",
        "reference/mems_impact.plot_run",
        "reference/mems_impact.Basins-class",
        "reference/mems_impact.basins",
    ):
        (tmp_path / f"{name}.html").write_text("")
    return tmp_path


@pytest.mark.parametrize(
    ("word", "ends"),
    [
        (None, "/index.html"),
        ("Basins", "/reference/mems_impact.Basins-class.html"),
        ("basins", "/reference/mems_impact.basins.html"),
        ("maps", "/maps.html"),
        ("time step", "/guide.html#methods"),
        ("gear wheel", "/search.html?q=gear%20wheel"),
        ("plot", "/figures.html"),
        ("stability", "/orbits.html#an-orbit"),
        ("period doublings", "/orbits.html#special-points-and-what-starts-there"),
    ],
)
def test_the_address_of_a_page(site, word, ends):
    address = docs.page(site, word)
    assert address.startswith("file:")
    assert address.endswith(ends)


def test_what_is_opened(cli, site, monkeypatch):
    opened = []
    monkeypatch.setattr(docs, "built_site", lambda: site)
    monkeypatch.setattr(docs.webbrowser, "open", opened.append)
    done = cli("docs", "maps")
    assert done.status == 0
    assert opened == [done.out.strip()] == [(site / "maps.html").as_uri()]


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("find_orbit", "mems_impact.find_orbit("),
        ("fitwarning", "mems_impact.FitWarning"),
        ("pull-in", "Usage: mems-impact pull-in"),
        ("grazing", "SpecialPoint: "),
        ("draw a tornado of sensitivity", "sensitivity: "),
    ],
)
def test_the_text_without_a_site(cli, word, said):
    done = cli("docs", word, "--text")
    assert done.status == 0
    assert said in done.out


def test_an_unknown_word(cli):
    assert "similar ones: find_orbit" in cli("docs", "find_orbitt", "--text").complaint()


WANTED = (
    "quality factor",
    "hertz",
    "resonance",
    "electrode area",
    "capacitance",
    "deadband",
    "hysteresis",
    "time step",
    "restitution",
    "Zeno",
)


def test_the_command_finds_the_words_of_a_designer(cli):
    for word in WANTED:
        done = cli("docs", *word.split(), "--text")
        assert done.status == 0
        lines = done.out.splitlines()
        assert lines[0].startswith(f"{word.lower()}: ")
        assert any(line.startswith("page: docs/") for line in lines[1:3])


def test_the_search_of_the_site_finds_the_words_of_a_designer():
    # It finds the pages that hold every word of a query.
    text = "".join(page.read_text("utf-8").lower() for page in DOCS.glob("*.md"))
    assert [word for word in WANTED if word.lower() not in text] == []


DOCS = Path(__file__).resolve().parents[2] / "docs"
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)


def test_topics_lead_to_names_and_headings():
    found = []
    for topic in docs.topics():
        page, _, heading = topic.page.partition("#")
        headings = HEADING.findall((DOCS / page).read_text("utf-8"))
        slugs = {re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings}
        unknown = [*({*topic.names} - {*mi.__all__}), *({heading} - {"", *slugs})]
        found += [f"{topic.name}: {each}" for each in unknown]
    assert not found, "\n".join(found)


TOPICS = {
    "how do I set Q": "quality factor",
    "my own equations": "own system",
    "air damping": "air damping",
    "set the electrode area": "electrode area",
    "pull-in voltage": "pull-in",
    "gap tolerance yield": "yield",
    "fit mu_s to measured speed": "measurement",
    "find an unstable orbit": "unstable orbit",
    "grazing curve in two parameters": "curve in two parameters",
    "Floquet multipliers": "Floquet multiplier",
    "run a map on 4 nodes": "cluster",
    "resume after a kill": "resume",
    "seed and reproduce": "seed",
    "limit memory": "memory",
    "read results back": "read results",
}


def test_questions_find_their_topics():
    assert {words: docs.topic_on(words).name for words in TOPICS} == TOPICS


def test_no_synonym_belongs_to_two_topics():
    words = [word.lower() for topic in docs.topics() for word in (topic.name, *topic.also)]
    assert len(words) == len(set(words))
