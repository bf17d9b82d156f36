"""Owns the types and limits that settings share."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field

SETTINGS = ConfigDict(extra="forbid", strict=False, allow_inf_nan=False)

MOST_IN_A_WAVE = 4096
"""Candidates of a wave at most: what a kill may lose, and what a driver holds in memory."""

MAX_COUNT = 1_000_000
"""Candidates, descents, points … at most: a proposal looks at all of them, and a million take it minutes."""

MAX_SWITCHES = 100_000_000
"""Switches of one ensemble at most: a thousandth of them know v_u to 0.01 cm/s; one candidate takes minutes."""

MAX_HORIZON_US = 1e6
"""Simulated time at most [µs]: a second, a hundred thousand periods of the plate."""

MAX_CM_S = 1e6
"""Speeds and penalties at most [cm/s]: beyond it, 10 km/s, sums of squares lose what they are about."""

Count = Annotated[int, Field(ge=1, le=MAX_COUNT, strict=True)]

Text = Annotated[str, Field(min_length=1)]

SwitchCount = Annotated[int, Field(ge=1, le=MAX_SWITCHES, strict=True)]

Positive = Annotated[float, Field(gt=0)]

Volts = Annotated[float, Field(ge=1, le=1000)]

NotNegative = Annotated[float, Field(ge=0)]

Probability = Annotated[float, Field(gt=0, lt=1)]
