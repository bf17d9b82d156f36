"""Claims about what is public: everything a script or a plug-in needs comes from `softclose` itself, and quickly."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import softclose
from softclose import load_config
from softclose.presets import preset_names

DOCS = sorted((Path(__file__).parents[1] / "docs" / "how-to").glob("*.md"))


@pytest.mark.parametrize("name", softclose.__all__)
def test_every_public_name_is_there(name: str) -> None:
    found = getattr(softclose, name)
    assert name == "__version__" or getattr(found, "__name__", name) == name
    assert name in dir(softclose)


def test_what_an_engine_and_a_device_model_are_written_with_is_public() -> None:
    assert {"Engine", "Problem", "Proposal", "Observation", "DeviceModel", "Responses"} <= set(softclose.__all__)


def test_importing_softclose_imports_none_of_it() -> None:
    code = "import sys, softclose; found = {'numpy', 'numba', 'pydantic'} & set(sys.modules); assert not found, found"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", DOCS, ids=lambda p: p.stem)
def test_no_page_imports_from_the_protocol_s_own_module(page: Path) -> None:
    assert not re.search(
        r"from softclose\.(propose\.protocol|device|ensemble|plugins)\b", page.read_text(encoding="utf-8")
    )


@pytest.mark.parametrize("name", preset_names())
def test_a_preset_is_loaded_by_its_name(name: str) -> None:
    config = load_config(name, ["campaign.seed=7"])
    assert config.campaign.seed == 7
    assert config.fingerprint() != load_config(name, ["campaign.seed=8"]).fingerprint()
