"""The explorer: a page in the browser with sliders for the parameters of a system.

Modules without a browser: `session` (system, sliders, state and address of a page), `snapshot`
(displayed data), `export` (saved files), `background` (computing threads). `view` draws with Bokeh,
`server` serves the page.
"""
