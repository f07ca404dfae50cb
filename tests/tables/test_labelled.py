"""Tables as labelled arrays."""

import math

import numpy as np
import pandas as pd
import pytest

import mems_impact as mi

pytest.importorskip("xarray")
DEVICE = mi.load_actuator("mita2003")


@pytest.fixture(scope="module")
def samples():
    return mi.simulate(DEVICE, mi.Sine(amplitude=20.0, omega=900.0), 3).samples(per_period=50)


def test_samples_over_time_with_units(samples):
    dataset = mi.to_xarray(samples)
    assert dataset["x2"].dims == ("t",)
    np.testing.assert_array_equal(dataset["x2"], samples["x2"])
    np.testing.assert_array_equal(dataset["t"], samples["t"])
    told = {str(name): dataset[name].attrs["units"] for name in samples.attrs["units"]}
    assert told == samples.attrs["units"]
    assert (told["x2"], told["t"]) == ("m", "s")
    assert dataset.attrs["system"] == samples.attrs["system"]


def test_a_result_has_its_tables_as_arrays_and_files(tmp_path):
    run = mi.simulate(DEVICE, mi.Sine(amplitude=35.0, omega=900.0), 3, initial=mi.State(v2=5e-3))
    assert len(run.impacts)
    assert {"events", "impacts", "corners"} <= set(run.tables())
    arrays = run.to_xarray()
    assert arrays["impacts"]["v2 before"].attrs["units"] == "m/s"
    run.to_parquet(tmp_path / "tables")
    impacts = pd.read_parquet(tmp_path / "tables" / "impacts.parquet")
    pd.testing.assert_frame_equal(impacts, run.impacts, check_categorical=False)
    assert impacts.attrs["units"] == run.impacts.attrs["units"]
    last = mi.simulate(DEVICE, mi.Sine(amplitude=20.0, omega=900.0), 3, keep="statistics")
    assert "impacts" not in last.tables()


def test_a_file_in_netcdf_has_modes_as_text(samples, tmp_path):
    xarray = pytest.importorskip("xarray")
    path = tmp_path / "samples.nc"
    mi.to_xarray(samples).to_netcdf(path, engine="scipy")
    with xarray.open_dataset(path, engine="scipy") as dataset:
        assert dataset["mode"].values.tolist() == samples["mode"].tolist()
        np.testing.assert_array_equal(dataset["x2"], samples["x2"])


@pytest.mark.parametrize(("damping", "flag"), [(0.0, math.nan), (0.1, 1.0), (-0.1, 0.0)])
def test_a_file_in_netcdf_has_the_stability_of_a_branch(damping, flag, tmp_path):
    xarray = pytest.importorskip("xarray")
    system = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.k * y.x - p.c * y.v),
        parameters={"k": 1.0, "c": damping},
    )  # fmt: skip
    branch = mi.continue_solution(mi.find_equilibria(system)[0], "k", stop=2.0)
    for table in (branch.table, branch.special_table):
        mi.to_xarray(table).to_netcdf(tmp_path / "branch.nc", engine="scipy")
        with xarray.open_dataset(tmp_path / "branch.nc", engine="scipy") as dataset:
            np.testing.assert_array_equal(dataset["stable"], [flag] * len(table))


def test_a_grid_has_its_axes():
    rows = [(a, w, a * w) for w in (1.0, 2.0) for a in (0.1, 0.2, 0.3)]
    table = pd.DataFrame(rows, columns=["amplitude", "omega", "speed"])
    table.attrs = {"units": {"amplitude": "V"}}
    dataset = mi.to_xarray(table, ("omega", "amplitude"))
    assert dataset["speed"].shape == (2, 3)
    assert float(dataset["speed"].sel(omega=2.0, amplitude=0.3)) == 0.6
    assert dataset["amplitude"].attrs == {"units": "V"}
    with pytest.raises(mi.InvalidParameter, match="no two rows are the same"):
        mi.to_xarray(pd.concat([table, table]), ("omega", "amplitude"))


def test_rows_without_distinct_labels_are_numbered():
    assert mi.to_xarray(pd.DataFrame({"a": [3, 4]}))["a"].dims == ("row",)


def test_an_unknown_column(samples):
    with pytest.raises(mi.InvalidParameter, match="index = 'time of day'"):
        mi.to_xarray(samples, "time of day")
    with pytest.raises(mi.InvalidParameter, match="a DataFrame"):
        mi.to_xarray(samples["x2"])


def test_without_xarray(samples, monkeypatch):
    monkeypatch.setattr("mems_impact.tables.find_spec", lambda _: None)
    with pytest.raises(mi.InvalidParameter, match=r"pip install 'mems-impact\[xarray\]'"):
        mi.to_xarray(samples)
