"""The explorer: a page in the browser whose sliders move a system, and what is computed for it.

What is computed knows no browser: `subject` (what is explored), `dials` (its sliders), `setting`
(the state of a page, and its address), `picture`, `floquet` and `diagram` (what is shown of it),
`export` (what is saved), `latest` (computing while the user goes on). `view` draws it with Bokeh,
`server` shows it.
"""
