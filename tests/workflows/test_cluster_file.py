"""Claims about the description of a batch scheduler's cluster, and of the job that a driver runs in."""

from __future__ import annotations

from pathlib import Path

import pytest

from softclose.settings import ConfigError
from softclose_workflows.errors import ExecutorError
from softclose_workflows.run.executors import Placement
from softclose_workflows.run.executors.batch import CLASSES, job_script
from softclose_workflows.run.executors.cluster_file import Cluster, check_cluster, load_cluster
from softclose_workflows.run.submission import DriverJob, submission

WHOLE = """
[cluster]
scheduler = "slurm"
jobs = 4
cores = 16
memory = "32GB"
walltime = "02:00:00"
queue = "normal"
project = "mems"
interface = "lo"
prologue = ["module load python"]
directives = ["--exclusive"]
log_folder = "{folder}/jobs"
"""


@pytest.fixture
def file(tmp_path: Path) -> str:
    path = tmp_path / "slurm.toml"
    path.write_text(WHOLE.format(folder=tmp_path))
    return str(path)


def test_a_file_says_all_that_a_job_is_submitted_with(file: str) -> None:
    script = job_script(load_cluster(file))
    for line in ("#SBATCH -p normal", "#SBATCH -A mems", "#SBATCH -t 02:00:00", "#SBATCH --exclusive"):
        assert line in script.splitlines()
    for part in ("--nworkers 16", "--nthreads 1", "--lifetime 6900s", "--lifetime-stagger 150s", "--interface lo"):
        assert part in script
    assert "--cpus-per-task=16" in script
    assert script.index("module load python") < script.index("dask_worker")
    assert "--tls-key" in script


def test_without_tls_no_key_is_handed_out(file: str) -> None:
    plain = Path(file).read_text() + "tls = false\n"
    Path(file).write_text(plain)
    assert "--tls-key" not in job_script(load_cluster(file))


@pytest.mark.filterwarnings("ignore:OAR Job memory")
@pytest.mark.parametrize("scheduler", CLASSES)
def test_other_schedulers_get_queue_project_and_walltime(scheduler: str) -> None:
    spec = check_cluster(
        {"scheduler": scheduler, "cores": 2, "memory": "2GB", "walltime": "01:00:00", "queue": "q7", "project": "p7"}
    )
    script = job_script(spec)
    assert "q7" in script
    assert "p7" in script
    assert "--lifetime 3300s" in script


@pytest.mark.parametrize(
    ("walltime", "lifetime"),
    [("02:00:00", (6900, 150)), ("1-00:00:00", (86100, 150)), ("00:10:00", (540, 30)), ("01:05", (35, 15))],
)
def test_workers_end_before_the_walltime(walltime: str, lifetime: tuple[int, int]) -> None:
    spec = check_cluster({"walltime": walltime})
    assert spec.lifetime_s == lifetime
    assert sum(lifetime) < spec.walltime_s


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"jobs": 0}, "[cluster] jobs is 0; it must be a whole number of 1 or more"),
        ({"cores": "four"}, "[cluster] cores is 'four'"),
        ({"scheduler": "slrum"}, "did you mean 'slurm'?"),
        ({"wait_s": 0}, "[cluster] wait_s is 0"),
        ({"qeueu": "a"}, "unknown key 'qeueu'; did you mean 'queue'?"),
        ({"walltime": "2 h"}, "hours:minutes:seconds"),
        ({"walltime": "00:01:00"}, "workers need more than 60 s"),
        ({"prologue": "module load"}, "[cluster] prologue is 'module load'"),
        ({"tls": "yes"}, "[cluster] tls is 'yes'; it must be true or false"),
    ],
)
def test_what_is_not_allowed_is_named(values: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError) as e:
        check_cluster(values)
    assert said in str(e.value)


def test_a_name_is_a_section_of_dasks_configuration(monkeypatch: pytest.MonkeyPatch) -> None:
    import dask

    with dask.config.set({"jobqueue.slurm.cores": 3, "jobqueue.slurm.memory": "3GB", "jobqueue.slurm.queue": "q3"}):
        script = job_script(load_cluster("slurm"))
    assert "#SBATCH -p q3" in script
    assert "--cpus-per-task=3" in script
    with pytest.raises(ConfigError, match=r"no file and no section jobqueue\.nowhere"):
        load_cluster("nowhere")


def test_missing_and_broken_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml cannot be read: there is no such file"):
        load_cluster(str(tmp_path / "none.toml"))
    broken = tmp_path / "broken.toml"
    broken.write_text("jobs = 0\n")
    with pytest.raises(ConfigError, match=r"broken\.toml: \[cluster\] jobs is 0"):
        load_cluster(str(broken))


def test_a_cluster_excludes_the_other_places() -> None:
    with pytest.raises(ExecutorError, match="exclude each other"):
        Placement(cluster=Cluster(), serial=True)
    assert Placement(cluster=Cluster()).n_processes == 0


def test_a_drivers_script_queues_its_successor_first_and_quotes_what_it_is_given(file: str) -> None:
    arguments = ["run", "my file.toml", "--store", "runs/a b.zarr"]
    planned = submission("runs/a b.zarr", arguments, load_cluster(file), DriverJob(walltime="06:00:00", turns=7))
    assert planned.name == "softclose-a-b"
    lines = planned.text.splitlines()
    assert "#SBATCH --time=06:00:00" in lines
    assert '"$turn" -lt 7' in planned.text
    assert planned.text.index("afterany") < planned.text.index("'my file.toml'")
    assert "'runs/a b.zarr'" in planned.text


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: DriverJob(walltime="a day"), "--walltime is 'a day'"),
        (lambda: DriverJob(turns=0), "--turns is 0"),
        (lambda: submission("a.zarr", [], Cluster(scheduler="pbs"), DriverJob()), "knows SLURM"),
    ],
)
def test_a_driver_that_cannot_be_submitted_is_an_error(make, said: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ExecutorError) as e:
        make()
    assert said in str(e.value)
