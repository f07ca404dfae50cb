"""`mems-impact docs` finds the page on a word, built or not."""

import pytest

from mems_impact.cli import docs


@pytest.fixture
def site(tmp_path):
    (tmp_path / "reference").mkdir()
    for name in (
        "index",
        "maps",
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
        ("stick and slip", "/search.html?q=stick%20and%20slip"),
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
        ("grazing", "grazing_type: "),
    ],
)
def test_the_text_without_a_site(cli, word, said):
    done = cli("docs", word, "--text")
    assert done.status == 0
    assert said in done.out


def test_a_word_of_which_nothing_is_said(cli):
    assert "near are find_orbit" in cli("docs", "find_orbitt", "--text").complaint()
