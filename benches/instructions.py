"""Instructions a view by callgrind: regressions that a noisy clock hides.

Valgrind (3.19) knows no AVX-512, so what is counted are the AVX2 kernels, on one thread, without Python: the program of
rows.rs looks through one camera and through five, and a view costs a quarter of the difference. The counts are compared
with those of instructions.json, which `--update` writes anew; they hold for one compiler. More than 3 % above them
fails.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import bench

BASELINE = Path(__file__).with_name("instructions.json")
TOLERANCE = 0.03
JOBS = [(name, fill) for name in ("bunny", "kitchen inside") for fill in ("bare", "rays")]
MORE = 4


def instructions(program: Path, raw: Path, fill: str, views: int) -> int:
    """Instructions of the whole process."""
    with tempfile.NamedTemporaryFile() as profile:
        valgrind = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={profile.name}"]
        run = subprocess.run(
            [*valgrind, program, raw, fill, str(views)],
            env=os.environ | {"RAYON_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            check=True,
        )
    found = re.search(r"Collected : (\d+)", run.stderr)
    assert found, run.stderr
    return int(found[1])


def main() -> None:
    asked = bench.options(__doc__, update=False)
    for tool in ("cargo", "valgrind"):
        if not shutil.which(tool):
            print(f"instructions: skipped, needs {tool}")
            return
    build = ["cargo", "build", "--quiet", "--release", "--example", "rows"]
    subprocess.run(build, cwd=bench.CLONE, check=True)
    program = bench.CLONE / "target" / "release" / "examples" / "rows"
    before = json.loads(BASELINE.read_text()) if BASELINE.exists() else {}
    counted: dict[str, int] = {}
    table = []
    with tempfile.TemporaryDirectory() as folder:
        for name, fill in JOBS[:1] if asked.quick else JOBS:
            setting = bench.setting(asked.meshes, name, 1 + MORE)
            raw = Path(folder, "scene.raw")
            bench.write_raw(raw, setting.scene, setting.cameras)
            few, many = (instructions(program, raw, fill, views) for views in (1, 1 + MORE))
            job = f"{name}, {fill}"
            counted[job] = (many - few) // MORE
            change = counted[job] / before[job] - 1 if job in before else None
            row = {"job": job, "million instructions a view": counted[job] / 1e6}
            row["a face"] = counted[job] / len(setting.scene)
            table.append(row | {"change, %": None if change is None else 100 * change})
    bench.show("Instructions a view, AVX2 kernels under callgrind", table)
    if asked.update:
        BASELINE.write_text(json.dumps(before | counted, indent=2) + "\n")
        return
    worse = [row["job"] for row in table if (row["change, %"] or 0) > 100 * TOLERANCE]
    if worse:
        sys.exit(f"more instructions than before: {'; '.join(worse)}. If that is meant, run with --update")


if __name__ == "__main__":
    main()
