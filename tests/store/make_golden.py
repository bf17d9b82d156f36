"""Makes tests/store/golden/version-3.zip, a store as this schema version writes it. Run once per schema version.

PYTHONPATH=store:tests python tests/store/make_golden.py
"""

import tempfile
import zipfile
from pathlib import Path

import small_store
from softclose_store import SCHEMA_VERSION, DriverStore

GOLDEN = Path(__file__).parent / "golden" / f"version-{SCHEMA_VERSION}.zip"

if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "golden.zarr"
        small_store.create(path)
        small_store.run(path, 5)
        with DriverStore(path) as store:
            small_store.write_wave(store, 5)
        with zipfile.ZipFile(GOLDEN, "x", zipfile.ZIP_DEFLATED) as archive:
            for file in sorted(path.rglob("*")):
                if file.is_file():
                    archive.writestr(
                        zipfile.ZipInfo(file.relative_to(path).as_posix()), file.read_bytes(), zipfile.ZIP_DEFLATED
                    )
