"""Messages of Python functions in the words of the command line."""

from __future__ import annotations

import re

import click

__all__ = ["FROM_FILE", "shell_wording"]

FROM_FILE = "mems_impact.from_file"  # in the context of click: a file holds the arguments
DRIVE_PREFIX = "drive_"  # of drive options, apart from the command's own options

# Parts of messages without a counterpart of the same shape: expressions and their replacements.
_PHRASES = (
    (r", or a Quantity\b", ""),
    (r"; the (nearest one|solution) is in \.partial", ""),
    (r", which are in \.partial", ""),
    (r"^terms = \(.*\): ", ""),
    (r"raise max_(steps|events)( if so many events are expected)?[,;:] ", ""),
    (r" or until=", ""),
    (r"\bthe bounds of over\b", "the bounds of --over"),
    (r"\(see kicked_state\)", "(--initial kicked)"),
    (r"\buse sweep\(\) ", "use mems-impact sweep "),
    (r"; use pull_in_charge\b", "; use mems-impact pull-in"),
    (r"a device in SI, such as actuator\.to_si\(scales\)", "a device in SI"),
    (r"use to_si of a dimensionless device first", "give a device in SI"),
    (r"\(lowest, highest\), None for none", "LOW:HIGH, one of which may be omitted"),
    (r"two numbers, low and high, or None for either", "LOW:HIGH, one of which may be omitted"),
    (r"compute its closing, or give the duration\b",
     "use mems-impact closing, or give --drive-duration, the time"),
    (r"\bdistributions of scipy\.stats by parameter: \{.*\}",
     "a distribution of scipy.stats and its numbers: norm:0.62:0.02, or 5%"),
)  # fmt: skip


def shell_wording(text: str, command: click.Command | None = None) -> str:
    """Return a message with options in place of the arguments that they set.

    The options belong to `command`, by default the running command. The message is unchanged if a
    file describes the study, since the file has the arguments' names.
    """
    context = click.get_current_context(silent=True)
    if context is None or context.meta.get(FROM_FILE):
        return text
    for phrase, replacement in _PHRASES:
        text = re.sub(phrase, replacement, text)
    options = _options(command or context.command)
    terms = _class_names()

    def replaced(match: re.Match[str]) -> str:
        expression = match.group()
        name = match["field"] or match["option"] or match["set"] or match["quoted"] or match["word"]
        value = match["option_value"] or match["value"] or match["quoted_value"] or ""
        if expression in terms:
            return terms[expression]
        if name not in options or (match["field"] and options[name] == f"--{name}"):
            return expression
        return f"{options[name]} {value.strip(chr(39) + chr(34))}".rstrip()

    return _ARGUMENT.sub(replaced, text)


_ARGUMENT = re.compile(
    r"""
    ^(?P<field>\w+)(?=\ =\ |:\ |\ \w[\w ]*\ =\ )             # tolerance = 0: …, over omega = …
    |\bOptions\((?P<option>\w+)=(?P<option_value>[^,)]*)\)   # Options(atol=1e-17)
    |\b[A-Z]\w*\([^()]*\)                                    # Sine(amplitude=0.2), left alone
    |(?<![\w.'-])(?P<set>\w+)=(?P<value>'\w*'|[\w.+-]*)      # periods=, transient=300
    |(?<![\w.'-])(?P<quoted>method|engine)\ (?P<quoted_value>'\w+')  # method 'auto'
    |(?<![\w./'"-])(?P<word>[a-z]+(?:_[a-z]+)+|(?:[A-Z][a-z]+){2,})(?![\w./'"])  # SlewRate
    """,
    re.VERBOSE,
)


def _options(command: click.Command) -> dict[str, str]:
    """Return the options of a command by the arguments that they set, its own before a drive's."""
    options: dict[str, str] = {}
    for parameter in command.params:
        if isinstance(parameter, click.Option) and parameter.name is not None:
            if parameter.name.startswith(DRIVE_PREFIX):
                options.setdefault(parameter.name.removeprefix(DRIVE_PREFIX), parameter.opts[0])
            else:
                options[parameter.name] = parameter.opts[0]
    return options


def _class_names() -> dict[str, str]:
    """Return the names of terms and kinds of drives by their classes."""
    from mems_impact.actuator.drives import WAVEFORMS
    from mems_impact.actuator.terms import TERM_CLASSES

    names = {kind: name for name, kind in TERM_CLASSES.items()}
    return names | {name: kind for kind, name in WAVEFORMS.items()}
