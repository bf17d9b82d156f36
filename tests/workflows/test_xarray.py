"""Claims about a real campaign in the hands of who has nothing but xarray: everything is in one tree, and explained."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from numpy.testing import assert_allclose, assert_array_equal

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import reference_pages

from small_campaigns import COARSE, make_campaign
from softclose.evaluate.pieces import here
from softclose.metrics.objective import Judged, assess
from softclose.population.lot import COLUMNS
from softclose.propose.plan import engine_of
from softclose.settings import CampaignConfig
from softclose.waveform import Trace
from softclose_store import fingerprint_of, open_campaign, verify
from softclose_workflows.analyses.assessed_trace import assess_trace, keep
from softclose_workflows.analyses.certify import certify, fresh_switches
from softclose_workflows.run.opening import design_at_the_end

SETTINGS = (
    *COARSE,
    "population.sampling=replicated",
    "explore.budget=0",
    "amplifier.gain_error=0.02",
    "model.quality_factor=20",
    "opening.release_us=300",
    "opening.brake=8",
    "opening.n_switches=30",
    "opening.watch_us=100",
)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = make_campaign(tmp_path_factory.mktemp("whole") / "a.zarr", *SETTINGS)
    certify(path, n_switches=100, top=2, store_trajectories=True)
    design_at_the_end(path, mapper=here, quiet=True)
    return path


@pytest.fixture(scope="module")
def tree(store: str) -> Any:
    return xr.open_datatree(store, engine="zarr", chunks=None)


def test_everything_is_in_the_tree_and_on_the_page(store: str, tree: Any) -> None:
    page = reference_pages.schema_page()
    best = open_campaign(store).best()
    assert best is not None
    assert {"/certification/100-1", f"/opening/{best.candidate}"} <= set(tree.groups)
    for node in tree.subtree:
        for name, array in node.variables.items():
            assert f"`{str(name).removeprefix('off_') if name != 'off_switch' else name}`" in page, (node.path, name)
            assert array.attrs.get("long_name"), (node.path, name)
            assert array.attrs.get("units"), (node.path, name)
    known = {
        "certification/…": tree["certification/100-1"],
        "opening/…": tree[f"opening/{best.candidate}"],
        "trajectories/release-…": tree[f"trajectories/release-{best.candidate}"],
        "trajectories/certification-…/…": tree["trajectories/certification-100-1/unshaped"],
    }
    for group, node in known.items():
        missing = set(reference_pages.RESULT_ARRAYS[group]) - set(node.variables) - set(COLUMNS)
        assert missing == set(), group
    assert verify(store).ok


def test_a_certificate_answers_for_its_switches_by_itself(store: str, tree: Any) -> None:
    """Which switches hit too hard: their parameters are beside what they did, and their figures follow by hand."""
    group = tree["certification/100-1"]
    config = CampaignConfig.from_dict(tree.attrs["config"])
    lot = fresh_switches(config, 100, seed=1)
    for name in lot:
        assert_array_equal(group[name], lot[name])
        assert group[name].attrs == {"units": COLUMNS[name].unit, "long_name": COLUMNS[name].long_name}
    row = group.isel(design=0)
    plain = assess(
        Judged(
            max_contact_speed=row.max_contact_speed.to_numpy(),
            closed=row.closed.to_numpy(),
            status=row.status.to_numpy(),
            settling_us=row.settling.to_numpy(),
        )
    )
    assert_allclose(row.v_u_cm_s, plain.v_u_cm_s, rtol=1e-12)
    assert group.closing_us.attrs["units"] == "µs"
    assert list(group.parameter.values) == ["start_us", "rise_us", "peak_us", "volts"]
    assert "switch" not in group.dims  # they are none of the campaign's


def test_an_opening_names_the_campaigns_own_switches(tree: Any) -> None:
    opening = next(iter(tree["opening"].children.values()))
    assert opening.release_held.dims == ("release", "switch")
    assert list(opening.release.values) == ["plain", "braked"]
    travels = opening.release_overshoot * tree["population"].D
    assert travels.sizes["switch"] == 30
    assert_array_equal(travels.isel(release=0), opening.release_overshoot[0].to_numpy() * tree["population"].D[:30])


def test_the_attributes_say_who_the_campaign_is_and_what_its_switches_share(store: str, tree: Any) -> None:
    attributes = tree.attrs
    config = CampaignConfig.from_dict(attributes["config"])
    assert fingerprint_of(attributes["config"]) == attributes["fingerprint"]
    constants = attributes["constants"]
    assert constants["plate_area"] == {"value": 16700.0, "units": "µm²", "long_name": "area of the plate"}
    # Eq. 3 by hand, from nothing but the store.
    lot = tree["population"]
    area = constants["plate_area"]["value"] * 1e-12
    permittivity = constants["epsilon_0"]["value"]
    pull_in = np.sqrt(8.0 * lot.K * (lot.G * 1e-6) ** 3 / (27.0 * permittivity * area))
    from softclose.switch.plate import pull_in_voltage

    switches = np.stack([lot[name] for name in ("D", "G", "K", "M")], axis=1)
    assert_allclose(pull_in, pull_in_voltage(switches), rtol=1e-12)
    for stage in open_campaign(store).stages:
        assert tree[stage].attrs["engine"] == engine_of(config, stage)


def test_the_scrambling_of_each_switch_is_a_column_of_the_lot(tree: Any) -> None:
    """Sixteen figures by hand, and their spread: what the stored intervals rest on."""
    lot, tables = tree["population"], tree["candidates"]
    assert lot.replicate.attrs["units"] == "1"
    assert_array_equal(np.bincount(lot.replicate.to_numpy().astype(int), minlength=16) > 0, True)
    stage = tree["search"]
    closed = stage.response.sel(quantity="closed", candidate=0) > 0
    by_scrambling = (~closed).groupby(lot.replicate.sel(switch=stage.switch)).mean()
    assert by_scrambling.sizes["replicate"] == 16
    assert_allclose(float((~closed).mean()), float(tables.records.sel(field="p_nc", candidate=0)))


def test_an_assessed_drive_joins_the_tree(store: str) -> None:
    found = assess_trace(store, Trace([0.0, 5.0, 300.0], [0.0, 90.0, 90.0]), n_switches=100)
    keep(store, "mine", found)
    tree = xr.open_datatree(store, engine="zarr", chunks=None)
    assert set(tree["traces/mine"].variables) == set(reference_pages.RESULT_ARRAYS["traces/…"])


def test_verify_names_a_group_that_is_not_listed_yet(store: str, tmp_path: Path) -> None:
    import shutil

    from click.testing import CliRunner

    from softclose_store import DriverStore
    from softclose_workflows.cli import main

    copy = str(shutil.copytree(store, tmp_path / "a.zarr"))
    with DriverStore(copy):
        certify(copy, n_switches=120, top=1)
        told = CliRunner().invoke(main, ["verify", copy])
        assert told.exit_code == 0
        assert "certification/120-1: whole, and not in the root's list" in told.output
    assert "not in the root's list" not in CliRunner().invoke(main, ["verify", copy]).output
