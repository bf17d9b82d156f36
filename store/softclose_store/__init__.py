"""The store of a campaign: one Zarr hierarchy that survives kills, proves its content and opens in any Zarr tool."""

from softclose_store.check.repair import Recompute, RepairReport, remove_orphans, repair
from softclose_store.check.report import Damage, Report
from softclose_store.check.verify import verify
from softclose_store.disk.files import check_writable, path_text
from softclose_store.disk.lock import Holder, lock_holder
from softclose_store.errors import (
    DamageError,
    LayoutError,
    LockedError,
    OtherAlgorithmError,
    OtherConfigurationError,
    RecordError,
    SchemaError,
    StoreError,
    StoreExistsError,
    StoreMissingError,
)
from softclose_store.groups import GroupArray, list_groups, write_group
from softclose_store.read.arrays import read_population
from softclose_store.read.by_hand import Changed
from softclose_store.read.reader import Best, Campaign, StoredResponses, Trajectories, open_campaign
from softclose_store.read.result_groups import ResultGroup, group_attributes, read_group
from softclose_store.read.table import result_of
from softclose_store.schema.digests import assessed_digest, canonical_json, fingerprint_of, proposals_digest
from softclose_store.schema.fields import (
    IMPACT_QUANTITIES,
    RESPONSE_QUANTITIES,
    SCHEMA_VERSION,
    CaseColumn,
    Constant,
    PopulationColumn,
)
from softclose_store.schema.group_metadata import BY_HAND
from softclose_store.schema.layout import CASE_PREFIX, MIN_INNER, Layout, StageLayout, largest_inner
from softclose_store.write.block import write_block, writing_s
from softclose_store.write.by_hand import Change
from softclose_store.write.create import StoreState, create_campaign, store_state
from softclose_store.write.driver import DriverStore
from softclose_store.write.extend import extend_campaign, finish_extension

__all__ = [
    "BY_HAND",
    "CASE_PREFIX",
    "IMPACT_QUANTITIES",
    "MIN_INNER",
    "RESPONSE_QUANTITIES",
    "SCHEMA_VERSION",
    "Best",
    "Campaign",
    "CaseColumn",
    "Change",
    "Changed",
    "Constant",
    "Damage",
    "DamageError",
    "DriverStore",
    "GroupArray",
    "Holder",
    "Layout",
    "LayoutError",
    "LockedError",
    "OtherAlgorithmError",
    "OtherConfigurationError",
    "PopulationColumn",
    "Recompute",
    "RecordError",
    "RepairReport",
    "Report",
    "ResultGroup",
    "SchemaError",
    "StageLayout",
    "StoreError",
    "StoreExistsError",
    "StoreMissingError",
    "StoreState",
    "StoredResponses",
    "Trajectories",
    "assessed_digest",
    "canonical_json",
    "check_writable",
    "create_campaign",
    "extend_campaign",
    "fingerprint_of",
    "finish_extension",
    "group_attributes",
    "largest_inner",
    "list_groups",
    "lock_holder",
    "open_campaign",
    "path_text",
    "proposals_digest",
    "read_group",
    "read_population",
    "remove_orphans",
    "repair",
    "result_of",
    "store_state",
    "verify",
    "write_block",
    "write_group",
    "writing_s",
]
