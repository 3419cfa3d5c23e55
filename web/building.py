"""Builds the package with maturin, and before that its pages, where Node.js is there to bundle them.

Without it the package has no pages, and says so when one is asked for.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import maturin
from maturin import (  # noqa: F401
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_editable,
    prepare_metadata_for_build_wheel,
)

WEB = Path(__file__).parent
PAGES = WEB.parent / "python" / "cyclorama" / "pages"


def build_wheel(*arguments: Any, **options: Any) -> str:
    bundle()
    return str(maturin.build_wheel(*arguments, **options))


def build_editable(*arguments: Any, **options: Any) -> str:
    bundle()
    return str(maturin.build_editable(*arguments, **options))


def build_sdist(*arguments: Any, **options: Any) -> str:
    bundle()
    return str(maturin.build_sdist(*arguments, **options))


def bundle() -> None:
    """The scripts of the pages, if they are older than their sources."""
    sources = [*WEB.glob("src/**/*.js"), WEB / "build.mjs", WEB / "package-lock.json"]
    made = list(PAGES.glob("*.js"))
    if made and min(map(changed, made)) >= max(map(changed, sources)):
        return
    npm = shutil.which("npm")
    if npm is None:
        print("no Node.js: the package has no pages", file=sys.stderr)
        return
    for command in (["ci", "--silent", "--no-fund", "--no-audit"], ["run", "--silent", "build"]):
        if subprocess.run([npm, *command], cwd=WEB, check=False).returncode:
            print(f"npm {command[0]} failed: the package has no pages", file=sys.stderr)
            return


def changed(path: Path) -> float:
    return path.stat().st_mtime
