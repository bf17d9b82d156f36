"""Owns tables: the history of a campaign and the ensemble of a candidate, as labelled xarray data sets and as files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from softclose_store import Campaign
from softclose_store.schema.fields import IMPACT_QUANTITIES, RECORDED, RESPONSE_QUANTITIES
from softclose_workflows.errors import ExportError
from softclose_workflows.tell.outputs import whole_file
from softclose_workflows.terminal import visible

if TYPE_CHECKING:
    import xarray as xr

FORMATS = ("csv", "parquet", "netcdf")
NEEDS = {"parquet": "pyarrow", "netcdf": "netCDF4"}
"""Package that a format needs beyond Softclose's own."""


def history_dataset(campaign: Campaign) -> xr.Dataset:
    """One entry per committed candidate: dimension candidate, one variable per column of `Campaign.history`."""
    import pandas as pd
    import xarray as xr

    table = campaign.history()
    assert isinstance(table, pd.DataFrame)  # xarray brings pandas
    units = {f.name: (f.unit, f.long_name) for f in RECORDED}
    variables = {}
    for name in table.columns:
        values = table[name].to_numpy()
        attributes = dict(zip(("units", "long_name"), units.get(str(name), _pulse_unit(str(name))), strict=True))
        variables[str(name)] = ("candidate", values, attributes)
    return xr.Dataset(variables, coords={"candidate": np.arange(len(table))}, attrs=_provenance(campaign))


def _pulse_unit(column: str) -> tuple[str, str]:
    if column.startswith("pulse"):
        return ("V" if column.endswith("volts") else "µs"), "one parameter of one pulse; a peak of inf holds"
    return "1", ""


def ensemble_dataset(campaign: Campaign, candidate: int, *, trajectories: bool = False) -> xr.Dataset:
    """One entry per switch of one candidate: its properties and its response; with `trajectories` x and v over time.

    Dimensions: switch, and impact and time where they are stored and asked for.
    """
    import xarray as xr

    responses = campaign.responses(candidate)
    n = responses.closed.size
    fields = {"first_contact": "first_contact_us", "settling": "settling_us"}
    population = campaign.population()
    variables: dict[str, Any] = {
        c.name: ("switch", population[c.name][:n], {"units": c.unit, "long_name": c.long_name})
        for c in campaign.layout.columns
    }
    for quantity in RESPONSE_QUANTITIES:
        values = np.asarray(getattr(responses, fields.get(quantity.name, quantity.name)))
        variables[quantity.name] = ("switch", values, {"units": quantity.unit, "long_name": quantity.long_name})
    coords: dict[str, Any] = {"switch": np.arange(n)}
    if trajectories:
        path = campaign.trajectories(candidate)
        coords["time"] = ("time", path.times_us, {"units": "µs"})
        for name, rows, unit, meaning in (("x", path.x, "µm", "travel x(t)"), ("v", path.v, "µm/µs", "velocity v(t)")):
            variables[name] = (("switch", "time"), rows[...], {"units": unit, "long_name": meaning})
        if responses.impact_time_us is not None and responses.impact_speed is not None:
            for field, rows in zip(IMPACT_QUANTITIES, (responses.impact_time_us, responses.impact_speed), strict=True):
                about = {"units": field.unit, "long_name": field.long_name}
                variables[f"impact_{field.name}"] = (("switch", "impact"), rows[...], about)
    attributes = _provenance(campaign) | {
        "candidate": candidate,
        "waveform": json.dumps([[_plain(v) for v in row] for row in campaign.waveform(candidate)]),
    }
    return xr.Dataset(variables, coords=coords, attrs=attributes)


def _plain(value: Any) -> float | None:
    return float(value) if np.isfinite(value) else None


def _provenance(campaign: Campaign) -> dict[str, Any]:
    return {"fingerprint": campaign.fingerprint, "config": json.dumps(campaign.config, sort_keys=True)}


def csv_text(dataset: xr.Dataset) -> str:
    """One row per entry of the first dimension. Texts that a spreadsheet would compute are quoted by an apostrophe."""
    table = dataset.to_dataframe()
    for name in table.columns:
        if table[name].dtype.kind not in "biuf":
            table[name] = [cell(value) if isinstance(value, str) else value for value in table[name]]
    return str(table.rename(columns=cell).to_csv(lineterminator="\n"))


def cell(text: Any) -> Any:
    """A text as a cell of a CSV: `=cmd|…` is no formula, whoever wrote it; control signs are spelt out."""
    if not isinstance(text, str):
        return text
    shown = visible(text).replace("\n", "\\n").replace("\t", "\\t")
    return "'" + shown if shown.lstrip()[:1] in ("=", "+", "-", "@") and shown else shown


def write_dataset(dataset: xr.Dataset, target: Path, form: str) -> None:
    """Write csv or parquet (one row per entry of the first dimension) or netcdf. Raises ExportError."""
    package = NEEDS.get(form)
    if package is not None:
        try:
            __import__(package)
        except ImportError as e:
            raise ExportError(f"{form} needs {package}: pip install {package}") from e
    if form != "netcdf" and len(dataset.sizes) > 1:
        raise ExportError(f"x(t), v(t) and impacts have two dimensions, which {form} has not; use --format netcdf")
    with whole_file(target) as partial:
        if form == "netcdf":
            dataset.to_netcdf(partial, engine="netcdf4", encoding=_encoding(dataset))
        elif form == "parquet":
            dataset.to_dataframe().to_parquet(partial)
        else:
            partial.write_text(csv_text(dataset), encoding="utf-8", newline="\n")


def _encoding(dataset: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Lossless compression of what is large."""
    return {str(name): {"zlib": True, "complevel": 4, "shuffle": True} for name, v in dataset.items() if v.ndim > 1}
