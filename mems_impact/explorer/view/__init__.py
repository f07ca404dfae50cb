"""The page of the explorer, drawn with Bokeh."""
