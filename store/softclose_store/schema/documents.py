"""Owns what the metadata of a store may say, checked by pydantic before anything is allocated or opened by it.

One place for every document: the root with its layout, the group `runtime`, result groups and their arrays. What a
field means stands where it is used; here stand types, ranges and bounds. `checked` turns what is wrong into one line.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, Strict, StringConstraints, ValidationError, model_validator

from softclose_store.schema.fields import N_SURROGATE, SCHEMA_VERSION

MOST_CANDIDATES = 10_000_000
"""Of a stage. What is allocated follows from the files that are there, not from this."""
MOST_SWITCHES = 100_000_000
MOST_STAGES = 500
MOST_COLUMNS = 200
"""Of a population."""
MOST_TABLE_CHUNK = 128
"""Candidates in one chunk of a table: what a table's file may hold follows from it."""
MOST_DECODED = 2**28
"""Most bytes of a chunk of a result group, decoded. A chunk of one design holds half a million."""

BoundedText = Annotated[str, StringConstraints(max_length=10_000)]
Digest = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]
Key = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_./-]*$", max_length=400)]
Name = Annotated[str, StringConstraints(max_length=200)]
ColumnEntry = Annotated[list[Name], Field(min_length=3, max_length=3)]
"""Name, unit and meaning of a column of the population, or of a candidate's design."""
CaseValues = Annotated[list[float], Field(min_length=1, max_length=1_000)]
CaseEntry = Annotated[tuple[Name, Name, Name, CaseValues], Strict(False)]
"""Name, unit, meaning and values, one a case, of what tells cases apart. JSON knows lists only."""
Json = dict[str, Any]

D = TypeVar("D", bound="Document")


class Document(BaseModel):
    """Metadata: exactly these fields, of exactly these types."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)


class OpenDocument(Document):
    """Metadata in which whoever wrote it may say more."""

    model_config = ConfigDict(strict=True, extra="allow", allow_inf_nan=False, frozen=True)


class StageDocument(Document):
    """Sizes of a stage, as the root says them."""

    name: Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,31}$")]
    n_candidates: Annotated[int, Field(ge=1, le=MOST_CANDIDATES)]
    n_switches: Annotated[int, Field(ge=1, le=MOST_SWITCHES)]
    block_candidates: Annotated[int, Field(ge=1, le=MOST_CANDIDATES)]
    block_switches: Annotated[int, Field(ge=1, le=MOST_SWITCHES)]
    engine: Name


class LayoutDocument(Document):
    """Sizes of a campaign, as the root says them."""

    stages: Annotated[list[StageDocument], Field(min_length=1, max_length=MOST_STAGES)]
    n_times: Annotated[int, Field(ge=0, le=200_000)]
    max_impacts: Annotated[int, Field(ge=0, le=4_096)]
    n_pulses: Annotated[int, Field(ge=1, le=1_000)]
    limits_cm_s: Annotated[list[float], Field(max_length=1_000)]
    columns: Annotated[list[ColumnEntry], Field(min_length=1, max_length=MOST_COLUMNS)]
    designs: Annotated[list[ColumnEntry], Field(max_length=MOST_COLUMNS)]
    asked: Annotated[list[ColumnEntry], Field(max_length=MOST_COLUMNS)]
    told: Annotated[list[ColumnEntry], Field(max_length=MOST_COLUMNS)] = []
    cases: Annotated[list[CaseEntry], Field(max_length=MOST_COLUMNS)]
    n_modes: Annotated[int, Field(ge=1, le=1_000)]
    table_chunk: Annotated[int, Field(ge=1, le=MOST_TABLE_CHUNK)] | None = None


class ConstantDocument(Document):
    """A number that every switch shares."""

    value: float
    units: BoundedText
    long_name: BoundedText


class RunDocument(OpenDocument):
    """Who ran a campaign, on what and with which versions: what readers look at has its type."""

    versions: Annotated[dict[str, BoundedText], Field(max_length=100)] | None = None
    processor: BoundedText | None = None
    machine: BoundedText | None = None
    system: BoundedText | None = None
    host: BoundedText | None = None
    user: BoundedText | None = None
    pid: int | None = None
    started: BoundedText | None = None
    workers: int | None = None
    spent: Annotated[dict[str, float], Field(max_length=100)] | None = None
    """Where the time of the run and of its workers went [s]; absent where it was killed."""


class RuntimeDocument(RunDocument):
    """Attributes of the group `runtime`: the creation, and the runs since."""

    runs: list[RunDocument] | None = None


class AttributesDocument(Document):
    """Attributes of the root."""

    kind: Literal["softclose-campaign"]
    softclose_schema: Literal[SCHEMA_VERSION]  # type: ignore[valid-type]
    fingerprint: Digest
    algorithm: BoundedText
    config: Json
    constants: Annotated[dict[BoundedText, ConstantDocument], Field(max_length=100)]
    layout: LayoutDocument
    durable: bool
    static_digests: Annotated[dict[Key, Digest], Field(max_length=10 * MOST_STAGES)]
    metadata_digest: Digest
    n_committed: Annotated[int, Field(ge=0)]
    n_waves: Annotated[int, Field(ge=0)]
    hyperparameters: Annotated[list[BoundedText], Field(max_length=N_SURROGATE)]
    root_digest: Digest

    @model_validator(mode="after")
    def _fits(self) -> AttributesDocument:
        budget = sum(stage.n_candidates for stage in self.layout.stages)
        if self.n_committed > budget:
            raise ValueError(f"n_committed is {self.n_committed}, and the stages have {budget} candidates")
        if self.n_waves > self.n_committed or (self.n_waves == 0) != (self.n_committed == 0):
            raise ValueError(f"n_waves is {self.n_waves} where n_committed is {self.n_committed}")
        return self


class ConsolidatedDocument(Document):
    """The metadata of everything, as zarr keeps them in the root; each is compared with the schema's own."""

    kind: Literal["inline"]
    must_understand: Literal[False]
    metadata: Annotated[dict[Key, Json], Field(max_length=40 * MOST_STAGES)]


class RootDocument(Document):
    """The root."""

    zarr_format: Literal[3]
    node_type: Literal["group"]
    attributes: AttributesDocument
    consolidated_metadata: ConsolidatedDocument


class GroupAttributes(OpenDocument):
    """Attributes of a result group: its files and digests, and whatever its result says of itself."""

    softclose_files: Annotated[dict[BoundedText, Digest], Field(max_length=100_000)]
    softclose_digest: Digest
    softclose_group: Key | None = None


class GroupDocument(OpenDocument):
    """Metadata of a result group."""

    zarr_format: Literal[3]
    node_type: Literal["group"]
    attributes: GroupAttributes


class ListedDocument(OpenDocument):
    """Metadata of a result group, or of a group that such lie in, as the root lists them."""

    zarr_format: Literal[3]
    node_type: Literal["group"]
    attributes: Json


class ChunkShape(Document):
    """How an array is cut."""

    chunk_shape: Annotated[list[Annotated[int, Field(ge=1)]], Field(max_length=8)]


class ChunkGrid(Document):
    """A regular grid of chunks."""

    name: Literal["regular"]
    configuration: ChunkShape


_ITEMSIZES = {"bool": 1, "string": 16} | {
    f"{kind}{bits}": bits // 8
    for kind, widths in {"int": (8, 16, 32, 64), "uint": (8, 16, 32, 64), "float": (16, 32, 64)}.items()
    for bits in widths
}


class GroupArrayDocument(OpenDocument):
    """Metadata of an array of a result group: types, sizes and codecs that `write_group` may have written."""

    zarr_format: Literal[3]
    node_type: Literal["array"]
    shape: Annotated[list[Annotated[int, Field(ge=0, le=10**10)]], Field(max_length=8)]
    data_type: Annotated[str, StringConstraints(max_length=20)]
    chunk_grid: ChunkGrid
    codecs: Annotated[list[Json], Field(min_length=1, max_length=4)]
    storage_transformers: Annotated[list[Json], Field(max_length=0)] = []

    @model_validator(mode="after")
    def _fits(self) -> GroupArrayDocument:
        if self.data_type not in _ITEMSIZES:
            raise ValueError(f"data_type is {self.data_type!r}; it must be one of {', '.join(_ITEMSIZES)}")
        first = "vlen-utf8" if self.data_type == "string" else "bytes"
        names = [str(codec.get("name")) for codec in self.codecs]
        if names not in ([first, "crc32c"], [first, "blosc", "crc32c"]):
            raise ValueError(f"codecs are {names}; they must be {first}, perhaps blosc, and crc32c")
        if len(self.chunks) != len(self.shape):
            raise ValueError(f"chunks are {self.chunks} where the shape is {self.shape}")
        if self.chunk_bytes > MOST_DECODED:
            raise ValueError(f"a chunk has {self.chunk_bytes:,} bytes; {MOST_DECODED:,} are the most")
        return self

    @property
    def chunks(self) -> list[int]:
        """Elements of a chunk along each dimension."""
        return self.chunk_grid.configuration.chunk_shape

    @property
    def chunk_bytes(self) -> int:
        """Bytes of a chunk, decoded; of text those of its places."""
        return math.prod(self.chunks) * _ITEMSIZES[self.data_type]

    @property
    def n_chunks(self) -> int:
        """Files that hold its elements."""
        return math.prod(-(-n // c) for n, c in zip(self.shape, self.chunks, strict=True))


def checked(model: type[D], document: Any) -> D:
    """Metadata of one kind.

    Parameters
    ----------
    model : type
        What they have to be.
    document : object
        JSON values.

    Returns
    -------
    Document

    Raises
    ------
    ValueError
        In one line: where it is wrong, what was got, what is allowed.
    """
    try:
        return model.model_validate(document)
    except ValidationError as e:
        first, n = e.errors(include_url=False)[0], e.error_count()
        place = ".".join(str(part)[:60] for part in first["loc"]) or "the document"
        got = repr(first["input"]) if not isinstance(first["input"], dict | list) else "not what it must be"
        more = f", and {n - 1} more" if n > 1 else ""
        what = first["msg"].removeprefix("Value error, ")
        raise ValueError(f"{place}: {what} (got {got[:80]}){more}") from e
