"""The explorer: a page in the browser whose sliders move a system, and what is computed for it.

What is computed knows no browser: `session` (the system, its sliders, the state of a page and its
address), `snapshot` (what is shown of it), `export` (what is saved), `background` (computing while
the user goes on). `view` draws it with Bokeh, `server` shows it.
"""
