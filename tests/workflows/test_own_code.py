"""A device model or an engine of one's own without a package: run where the user allows that very one, only there."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from subprocess import PIPE

import pytest

from campaigns import SMALL
from examples import in_turn, is_whole
from forked import Forked
from softclose import EngineError, allow_code, load_config, plugins
from softclose.settings import ConfigError
from stores import differences

CODE = """
import pathlib
from softclose import simulate as shipped
from softclose.propose.sobol import SobolEngine

pathlib.Path(__file__).with_name("imported").touch()


def simulate(switches, waveform, **settings):
    return shipped(switches, waveform, **settings)


class Mine(SobolEngine):
    pass
"""
MODEL, ENGINE = "my_switch:simulate", "my_switch:Mine"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the module, the configuration that names it, and nothing installed."""
    (tmp_path / "my_switch.py").write_text(CODE)
    (tmp_path / "own.toml").write_text(f'[model]\nname = "{MODEL}"\n[optimiser]\nengine = "{ENGINE}"\n')
    monkeypatch.chdir(tmp_path)
    return tmp_path


def softclose(folder: Path, *arguments: str, allowed: tuple[str, ...] = (), code: int = 0, env: str = "") -> str:
    """What a command says in a process of its own, which stands in the folder."""
    flags = [word for name in allowed for word in ("--allow-code", name)]
    (folder / "imported").unlink(missing_ok=True)
    environment = os.environ | {plugins.ALLOWED: env, "OMP_NUM_THREADS": "1"}
    process = Forked(*flags, *arguments, env=environment, folder=folder, stdout=PIPE, stderr=PIPE)
    stdout, stderr = process.communicate(timeout=180)
    assert process.returncode == code, stderr
    assert "Traceback" not in stderr
    return stdout + stderr


SETS = tuple(word for setting in SMALL for word in ("--set", setting))
BOTH = (MODEL, ENGINE)


@pytest.mark.parametrize("allowed", in_turn([(), (MODEL,), (ENGINE,), ("my_switch:other", "os:system")], 3))
def test_what_the_user_does_not_allow_is_not_even_imported(folder: Path, allowed: tuple[str, ...]) -> None:
    said = softclose(folder, "run", "own.toml", "--store", "a.zarr", "--serial", *SETS, allowed=allowed, code=2)
    assert "which is code. It runs only where you say so yourself" in said
    assert "softclose --allow-code my_switch:" in said
    assert not (folder / "imported").exists()
    assert not (folder / "a.zarr").exists()


def test_the_environment_alone_allows_nothing(folder: Path) -> None:
    run = ("run", "own.toml", "--store", "a.zarr", "--serial", *SETS)
    assert "which is code" in softclose(folder, *run, code=2, env=" ".join(BOTH))


@pytest.mark.sampled
def test_it_runs_where_it_is_allowed_and_a_store_allows_nothing(folder: Path) -> None:
    run = ("run", "own.toml", "--store", "a.zarr", "--serial", "--quiet", *SETS)
    softclose(folder, *run, allowed=BOTH)
    assert (folder / "imported").exists()
    reading = (("report", "a.zarr", "-o", "a.html"), ("status", "a.zarr"), ("export", "a.zarr", "waveform"))
    for command in reading if is_whole() else reading[:1]:
        softclose(folder, *command)
        assert not (folder / "imported").exists(), command
    simulating = (("certify", "a.zarr", "--switches", "100"), ("tolerance", "a.zarr", "--gain", "0.01"))
    for command in simulating if is_whole() else simulating[:1]:
        assert "which is code" in softclose(folder, *command, code=2)
        assert not (folder / "imported").exists(), command
    softclose(folder, "certify", "a.zarr", "--switches", "100", "--top", "1", allowed=BOTH)
    shipped = ("--set", "model.name=single-mode", "--set", "optimiser.engine=sobol")
    softclose(folder, "run", "own.toml", "--store", "b.zarr", "--serial", "--quiet", *SETS, *shipped)
    assert differences(folder / "a.zarr", folder / "b.zarr") != [], "they are different campaigns"


@pytest.mark.slow
def test_workers_run_what_their_user_allows(folder: Path) -> None:
    softclose(folder, "run", "own.toml", "--store", "a.zarr", "--serial", "--quiet", *SETS, allowed=BOTH)
    run = ("run", "own.toml", "--store", "b.zarr", "--workers", "2", "--quiet", *SETS)
    softclose(folder, *run, allowed=BOTH)
    assert differences(folder / "a.zarr", folder / "b.zarr") == []


def test_what_is_allowed_must_exist_and_be_a_name(folder: Path) -> None:
    run = ("run", "own.toml", "--store", "a.zarr", "--serial", "--quiet", *SETS)
    assert "is no code to allow" in softclose(folder, *run, allowed=("my_switch",), code=2)
    missing = ("--set", "model.name=not_there:simulate")
    said = softclose(folder, *run, *missing, allowed=(*BOTH, "not_there:simulate"), code=2)
    assert "there is no module not_there: stand in its folder" in said
    assert not (folder / "a.zarr").exists()


def test_from_python_a_call_allows_it(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(plugins.ALLOWED, "")
    with pytest.raises(ConfigError, match="which is code"):
        load_config("own.toml")
    allow_code(*BOTH)
    assert load_config("own.toml").model.name == MODEL
    with pytest.raises(EngineError, match="no code to allow"):
        allow_code("rm -rf")
    shutil.copy("my_switch.py", "other.py")
    with pytest.raises(ConfigError, match="which is code"):
        load_config("own.toml", ["model.name=other:simulate"])
