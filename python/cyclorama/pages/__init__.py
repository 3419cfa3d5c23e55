"""Pages, and the scripts of pages and widgets, bundled from `web/` when the package is built: they need no network.

Three.js is part of the scripts; its licence (MIT) stands at the end of each.
"""

from __future__ import annotations

from pathlib import Path

__all__ = ["page", "script"]


def page(name: str) -> str:
    """The text of a page that a server sends.

    Parameters
    ----------
    name : str
        Without an ending.
    """
    return Path(__file__).with_name(f"{name}.html").read_text(encoding="utf-8")


def script(name: str) -> str:
    """A bundled script.

    Parameters
    ----------
    name : str
        Of the bundle, without an ending.

    Raises
    ------
    FileNotFoundError
        If the package was built without Node.js; the message says how to add it.
    """
    path = Path(__file__).with_name(f"{name}.js")
    if not path.exists():
        raise FileNotFoundError(
            f"{path.name} is not in this package, which was built without Node.js: install that (nodejs and npm), then "
            "build again with `pip install --force-reinstall --no-deps .`; in the sources `make pages` will do"
        )
    return path.read_text(encoding="utf-8")
