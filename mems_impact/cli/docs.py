"""`mems-impact docs`: the page on a word, in a browser or as text."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import NamedTuple

import click

from mems_impact.cli.output import OutputValue, add_json_values, show, show_text
from mems_impact.cli.runtime import quiet, write_message

BUILD = "python -m sphinx docs docs/_build/html"
MAX_SUGGESTIONS = 5  # suggestions for an unknown word


class Topic(NamedTuple):
    """A topic of `topics.toml`."""

    name: str
    also: tuple[str, ...]  # synonyms
    answer: str  # one line
    names: tuple[str, ...]  # public names that serve
    page: str  # page below `docs`, with its heading


@click.command(short_help="Open the documentation on a name, a command or a topic.")
@click.argument("words", metavar="[WORD]...", nargs=-1)
@click.option("--text", is_flag=True, help="Show the text in the terminal; open no browser.")
def command(*, words: tuple[str, ...], text: bool) -> None:
    """Open the page on WORD: a public name, a command or a topic; by default the first page.

    \b
    Examples:
      mems-impact docs find_orbit
      mems-impact docs sweep --text
      mems-impact docs quality factor
      mems-impact docs "one arc took more than max_steps = 100000 steps"

    WORD may be the text of a message, or a part of it: the topic that the message names is found.
    If the site has been built in this clone, the page opens in a browser, without a network.
    Otherwise, or with --text, the terminal shows the text: the docstring of a name, the options of
    a command, the answer on a topic and the names whose docstrings mention it.
    """  # noqa: D301 - click looks for the backspace itself
    word = " ".join(words) or None
    site = built_site()
    if not text and site is not None:
        address = page(site, word)
        add_json_values({"address": OutputValue(address)})
        show(address)
        webbrowser.open(address)
        return
    show_text(text_on(word))
    if site is None and not text and not quiet():
        write_message(f"to build the site with pictures, in a clone: {BUILD}")


def built_site() -> Path | None:
    """Return the folder of the site built in this clone, or None."""
    site = Path(__file__).resolve().parents[2] / "docs" / "_build" / "html"
    return site if (site / "index.html").is_file() else None


def page(site: Path, word: str | None) -> str:
    """Return the address of the page on a word: reference, topic, own page or search."""
    if word is None:
        return (site / "index.html").as_uri()
    stem = word.lower().replace(" ", "_").replace("-", "_")
    topic = topic_on(word)
    of_topic = [] if topic is None else [topic.page]
    is_name = topic is not None and any(_same(word, name) for name in (topic.name, *topic.also))
    word_pages = [f"{stem}.html"]
    candidates = [*of_topic, *word_pages] if is_name else [*word_pages, *of_topic]
    candidates += [
        each.relative_to(site).as_posix() for each in sorted(site.glob(f"*/*{stem}*.html"))
    ]
    name = public(word)
    if name is not None:
        kinds = (f"mems_impact.{name}-class.html", f"mems_impact.{name}.html")
        candidates = [*(f"reference/{kind}" for kind in kinds), *candidates]
    for candidate in candidates:
        path, _, heading = candidate.partition("#")
        address = (site / path).with_suffix(".html")
        if address.is_file():
            return f"{address.as_uri()}#{heading}" if heading else address.as_uri()
    from urllib.parse import quote

    return f"{(site / 'search.html').as_uri()}?q={quote(word)}"


def public(word: str) -> str | None:
    """Return the public name that equals a word, ignoring case, or None."""
    import mems_impact as mi

    if word in mi.__all__:
        return word
    same = [name for name in mi.__all__ if name.lower() == word.lower()]
    return same[0] if same else None


def topics() -> list[Topic]:
    """Return all topics."""
    import tomllib
    from importlib.resources import files

    text = (files("mems_impact.cli") / "topics.toml").read_text("utf-8")
    return [
        Topic(name, tuple(each["also"]), each["answer"], tuple(each["names"]), each["page"])
        for name, each in tomllib.loads(text).items()
    ]


def topic_on(phrase: str) -> Topic | None:
    """Return the topic with the longest name or synonym whose words all occur, or None."""
    stems = _stems(phrase)
    matches = [
        (len(name), topic)
        for topic in topics()
        for name in (topic.name, *topic.also)
        if stems.issuperset(_stems(name))
    ]
    return max(matches, key=lambda each: each[0])[1] if matches else None


def _folded(phrase: str) -> str:
    return phrase.lower().replace("_", " ").replace("-", " ")


def _stems(phrase: str) -> set[str]:
    """Return the words without the ending of a plural."""
    return {word.removesuffix("s") if len(word) > 3 else word for word in _folded(phrase).split()}


def _same(word: str, other: str) -> bool:
    return _stems(word) == _stems(other)


def text_on(word: str | None) -> str:
    """Return the documentation on a word as text: all names without one."""
    import inspect

    import mems_impact as mi
    from mems_impact.cli.commands import COMMAND_NAMES

    names = sorted(mi.__all__, key=str.lower)
    docstrings = {name: inspect.getdoc(getattr(mi, name)) or "" for name in names}
    lines = {name: text.partition("\n")[0] for name, text in docstrings.items()}
    if word is None:
        return "\n".join(f"{name}: {line}" for name, line in lines.items())
    paragraphs = []
    name = public(word)
    if name is not None:
        value = getattr(mi, name)
        paragraphs.append(f"mems_impact.{name}{signature(value)}\n\n{docstrings[name]}")
    if word in COMMAND_NAMES:
        paragraphs.append(help_of(word))
    if not paragraphs:
        topic = topic_on(word)
        served = topic.names if topic is not None else ()
        if topic is not None:
            paragraphs += [f"{topic.name}: {topic.answer}", f"page: docs/{topic.page}"]
        phrase = _folded(word)
        mentioned = [
            n for n in names if len(word) > 2 and phrase in _folded(f"{n} {docstrings[n]}")
        ]
        of_phrase = [n for n in map(public, word.split()) if n is not None]
        paragraphs += [f"{n}: {lines[n]}" for n in dict.fromkeys((*served, *of_phrase, *mentioned))]
    if not paragraphs:
        from difflib import get_close_matches

        close = get_close_matches(
            word,
            [*names, *COMMAND_NAMES, *(topic.name for topic in topics())],
            MAX_SUGGESTIONS,
            cutoff=0.5,
        )
        hint = f"; similar ones: {', '.join(dict.fromkeys(close))}" if close else ""
        raise click.UsageError(f"no name, command or topic of the documentation is {word!r}{hint}")
    return "\n".join(paragraphs)


def signature(value: object) -> str:
    """Return the signature of a name without types, which its docstring gives."""
    import inspect

    assert callable(value)
    try:
        full = inspect.signature(value)
    except ValueError:  # a warning: Python's own constructor
        return ""
    bare = [each.replace(annotation=inspect.Parameter.empty) for each in full.parameters.values()]
    return str(full.replace(parameters=bare, return_annotation=inspect.Signature.empty))


def help_of(name: str) -> str:
    """Return the help page of a command."""
    group = click.get_current_context().parent
    assert group is not None
    assert isinstance(group.command, click.Group)
    command = group.command.get_command(group, name)
    assert command is not None
    return command.get_help(click.Context(command, info_name=name, parent=group))
