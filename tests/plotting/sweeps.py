"""A table of a sweep, made by hand."""

import numpy as np
import pandas as pd

QUANTITIES = {
    "step": ["displacement per impact", "step per impact"],
    "speed": ["mean speed", "mean speed"],
}


def sweep_table(statuses=("ok", "ok", "ok"), **attrs):
    """Return a sweep over 0.1, 0.2, 0.3 that begins to impact at 0.3 and ceases at 0.1."""
    impacts = {"up": [0.0, 0.0, 1.0], "down": [1.0, 1.0, 0.0]}
    rows = []
    for direction, values in (("up", (0.1, 0.2, 0.3)), ("down", (0.3, 0.2, 0.1))):
        for value, hits, status in zip(values, impacts[direction], statuses, strict=True):
            good = status == "ok"
            rows.append((value, direction, 0.0, value if good else np.nan, 0.0,
                         hits if good else np.nan, hits if good else np.nan, 0.0,
                         status))  # fmt: skip
    columns = ["amplitude", "direction", "period", "v2", "v1", "impacts per period",
               "blows per period", "displacement per period", "status"]  # fmt: skip
    table = pd.DataFrame(rows, columns=columns)
    section = {"states": ["v2", "v1"], "section": ["x2", 0.0], "symbols": {"amplitude": "$f$"}}
    table.attrs = {**section, "quantities": QUANTITIES, **attrs}
    return table


def silent_table():
    """Return a table whose last value of each chain never crosses the section, with speeds."""
    table = sweep_table()
    table.loc[table["amplitude"] == 0.1, "v2"] = np.nan
    table["displacement per impact"] = np.where(table["impacts per period"] > 0, 1e-4, np.nan)
    table["mean speed"] = 2e-5 * table["impacts per period"]
    return table
