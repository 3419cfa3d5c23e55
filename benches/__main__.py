"""Runs every script of this folder, or the named ones, and prints their tables: `python benches [--quick] [NAME ...]`.

Each script also runs alone, and says with `--help` what it measures. A script that fails does not stop the others.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from functools import partial
from pathlib import Path

from cyclorama import lab

HERE = Path(__file__).resolve().parent
SCRIPTS = sorted(path.stem for path in HERE.glob("*.py") if path.stem not in ("__main__", "bench", "rivals"))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python benches", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(SCRIPTS))
    parser.add_argument("--quick", action="store_true", help="fewer meshes and rounds, to see that all run")
    asked = parser.parse_args()
    unknown = sorted(set(asked.names) - set(SCRIPTS))
    if unknown:
        parser.error(f"there is no {unknown[0]}: choose from {', '.join(SCRIPTS)}")
    failed = []
    for name in asked.names or SCRIPTS:
        command = [sys.executable, str(HERE / f"{name}.py"), *(["--quick"] if asked.quick else [])]
        done, seconds = lab.elapsed(partial(subprocess.run, command, check=False))
        if done.returncode:
            failed.append(name)
        print(f"\n({name}: {seconds:.0f} s)", flush=True)
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
