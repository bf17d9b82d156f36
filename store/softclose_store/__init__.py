"""The store of a campaign: one Zarr hierarchy that survives kills, proves its content and opens in any Zarr tool."""

from softclose_store.chunk import read_switches, write_chunk
from softclose_store.create import StoreState, create_campaign, store_state
from softclose_store.digests import canonical_json, fingerprint_of
from softclose_store.driver import DriverStore
from softclose_store.errors import (
    DamageError,
    LayoutError,
    LockedError,
    OtherConfigurationError,
    RecordError,
    SchemaError,
    StoreError,
    StoreExistsError,
    StoreMissingError,
)
from softclose_store.groups import GroupArray, ResultGroup, group_attributes, list_groups, read_group, write_group
from softclose_store.layout import SCHEMA_VERSION, Layout
from softclose_store.lock import lock_holder
from softclose_store.reader import Best, Campaign, StoredResponses, Trajectories, open_campaign
from softclose_store.repair import Recompute, RepairReport, remove_orphans, repair
from softclose_store.verify import Problem, Report, verify

__all__ = [
    "SCHEMA_VERSION",
    "Best",
    "Campaign",
    "DamageError",
    "DriverStore",
    "GroupArray",
    "Layout",
    "LayoutError",
    "LockedError",
    "OtherConfigurationError",
    "Problem",
    "Recompute",
    "RecordError",
    "RepairReport",
    "Report",
    "ResultGroup",
    "SchemaError",
    "StoreError",
    "StoreExistsError",
    "StoreMissingError",
    "StoreState",
    "StoredResponses",
    "Trajectories",
    "canonical_json",
    "create_campaign",
    "fingerprint_of",
    "group_attributes",
    "list_groups",
    "lock_holder",
    "open_campaign",
    "read_group",
    "read_switches",
    "remove_orphans",
    "repair",
    "store_state",
    "verify",
    "write_chunk",
    "write_group",
]
