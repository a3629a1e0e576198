"""The files of the page: our own scripts and styles, and three.js from the package that ships it."""

from __future__ import annotations

import importlib.util
import io
import re
import zipfile
from functools import cache
from importlib import resources
from pathlib import Path

from dynident.errors import MissingDependency

KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}

_VIEWER = "resources/templates/viewer.zip"
#: The library as its authors build it: a comment with the licence, then one line that sets the global THREE. What
#: follows in the viewer is the viewer's own.
_LIBRARY = re.compile(
    r"/\*\*\s*\n \* @license\s*\n \* Copyright [0-9-]+ Three\.js Authors.*?\*/\s*\n(!function[^\n]+)\n", re.DOTALL
)


@cache
def asset(name: str) -> tuple[bytes, str] | None:
    """Return the bytes and the kind of a file of the page; None where the page has no such file."""
    if name == "report.css":  # colours and type are those of the report
        spec = importlib.util.find_spec("dynident.results.report")  # finds it without importing it, which takes long
        assert spec is not None and spec.submodule_search_locations
        return (Path(spec.submodule_search_locations[0]) / "templates" / "style.css").read_bytes(), KINDS[".css"]
    folder = resources.files("dynident.studio") / "static"
    if name not in {entry.name for entry in folder.iterdir()} or Path(name).suffix not in KINDS:
        return None
    return (folder / name).read_bytes(), KINDS[Path(name).suffix]


@cache
def three_js() -> bytes:
    """Return three.js as a script that sets the global ``THREE``: the one inside the viewer of the package trimesh.

    Nothing of the package is run.

    Raises:
        MissingDependency: The package is not installed, or its viewer has no such script.
    """
    missing = MissingDependency("the 3D view of the studio", "trimesh", "studio")
    found = importlib.util.find_spec("trimesh")
    if found is None or not found.submodule_search_locations:
        raise missing
    try:
        packed = (Path(found.submodule_search_locations[0]) / _VIEWER).read_bytes()
        with zipfile.ZipFile(io.BytesIO(packed)) as archive:
            pages = [archive.read(name).decode() for name in archive.namelist() if name.endswith(".html.template")]
    except (OSError, zipfile.BadZipFile) as error:
        raise missing from error
    scripts = [match.group() for page in pages for match in _LIBRARY.finditer(page)]
    if not scripts:
        raise missing
    return scripts[0].encode()
