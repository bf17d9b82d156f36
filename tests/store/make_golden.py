"""Makes tests/store/golden/version-1.zip, a store as schema version 1 writes it. Run once per schema version.

PYTHONPATH=store:tests python tests/store/make_golden.py
"""

import tempfile
import zipfile
from pathlib import Path

import numpy as np

import small_store
from softclose_store import SCHEMA_VERSION, DriverStore

GOLDEN = Path(__file__).parent / "golden" / f"version-{SCHEMA_VERSION}.zip"

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "golden.zarr"
        small_store.create(path, n_candidates=3, n_switches=5, chunk_switches=3, times_us=np.linspace(0.0, 250.0, 5))
        with DriverStore(path) as store:
            for i in range(2):
                small_store.run_candidate(store, i, 5 - i)
            store.propose(2, small_store.proposal(2, 5))
        with zipfile.ZipFile(GOLDEN, "x", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(path.rglob("*")):
                if file.is_file():
                    archive.writestr(
                        zipfile.ZipInfo(file.relative_to(path).as_posix()), file.read_bytes(), zipfile.ZIP_DEFLATED
                    )
