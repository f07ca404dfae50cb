"""`mems-impact docs`: the page on a word, in a browser or as text."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import click

from mems_impact.cli.output import OutputValue, show, show_text, tell_values
from mems_impact.cli.runtime import quiet, say

BUILD = "python -m sphinx docs docs/_build/html"
CLOSE = 5  # how many names are told where a word is none of them


@click.command(short_help="Open the documentation on a name, a command or a topic.")
@click.argument("word", required=False)
@click.option("--text", is_flag=True, help="Show the text here; open no browser.")
def command(*, word: str | None, text: bool) -> None:
    """Open the page on WORD, a name of Python, a command or a topic; without WORD the first page.

    Where the site has been built in this clone it opens in a browser, without a network. Else, or
    with --text, the text is shown here: a name with its docstring, a command with its options, and
    of a topic the names that speak of it.

    \b
    Examples:
      mems-impact docs find_orbit
      mems-impact docs sweep --text
      mems-impact docs grazing
    """  # noqa: D301 - click looks for the backspace itself
    site = built_site()
    if not text and site is not None:
        address = page(site, word)
        tell_values({"address": OutputValue(address)})
        show(address)
        webbrowser.open(address)
        return
    show_text(told(word))
    if site is None and not text and not quiet():
        say(f"as a site with pictures: {BUILD}, in a clone")


def built_site() -> Path | None:
    """Return where the site of this clone has been built, or None."""
    site = Path(__file__).resolve().parents[2] / "docs" / "_build" / "html"
    return site if (site / "index.html").is_file() else None


def page(site: Path, word: str | None) -> str:
    """Return the address of the page on a word: of the reference, of its own, or of a search."""
    if word is None:
        return (site / "index.html").as_uri()
    topic = word.lower().replace(" ", "_").replace("-", "_")
    candidates = [site / f"{topic}.html", *sorted(site.glob(f"*/*{topic}*.html"))]
    name = public(word)
    if name is not None:
        kinds = (f"mems_impact.{name}-class.html", f"mems_impact.{name}.html")
        candidates = [*(site / "reference" / kind for kind in kinds), *candidates]
    for candidate in candidates:
        if candidate.is_file():
            return candidate.as_uri()
    from urllib.parse import quote

    return f"{(site / 'search.html').as_uri()}?q={quote(word)}"


def public(word: str) -> str | None:
    """Return the public name that is meant, the case of letters aside, or None."""
    import mems_impact as mi

    if word in mi.__all__:
        return word
    same = [name for name in mi.__all__ if name.lower() == word.lower()]
    return same[0] if same else None


def told(word: str | None) -> str:
    """Return what there is to say on a word, as text."""
    import inspect

    import mems_impact as mi
    from mems_impact.cli import COMMANDS

    names = sorted(mi.__all__, key=str.lower)
    lines = {name: (inspect.getdoc(getattr(mi, name)) or "").partition("\n")[0] for name in names}
    if word is None:
        return "\n".join(f"{name}: {line}" for name, line in lines.items())
    parts = []
    name = public(word)
    if name is not None:
        thing = getattr(mi, name)
        parts.append(f"mems_impact.{name}{signature(thing)}\n\n{inspect.getdoc(thing)}")
    if word in COMMANDS:
        parts.append(help_of(word))
    if not parts:
        spoken = [
            n for n in names if word.lower() in f"{n} {inspect.getdoc(getattr(mi, n))}".lower()
        ]
        parts += [f"{n}: {lines[n]}" for n in spoken]
    if not parts:
        from difflib import get_close_matches

        close = get_close_matches(word, [*names, *COMMANDS], CLOSE, cutoff=0.5)
        hint = f"; near are {', '.join(close)}" if close else ""
        raise click.UsageError(f"nothing is said of {word!r}{hint}")
    return "\n".join(parts)


def signature(thing: object) -> str:
    """Return how a name is called, without the types, which its text tells."""
    import inspect

    assert callable(thing)
    try:
        found = inspect.signature(thing)
    except ValueError:  # a warning: Python's own constructor
        return ""
    bare = [each.replace(annotation=inspect.Parameter.empty) for each in found.parameters.values()]
    return str(found.replace(parameters=bare, return_annotation=inspect.Signature.empty))


def help_of(name: str) -> str:
    """Return the help page of a command."""
    group = click.get_current_context().parent
    assert group is not None
    assert isinstance(group.command, click.Group)
    found = group.command.get_command(group, name)
    assert found is not None
    return found.get_help(click.Context(found, info_name=name, parent=group))
