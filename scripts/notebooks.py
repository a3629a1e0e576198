"""Run the notebooks of examples/notebooks and write them as pages with their outputs into docs/notebooks.

Each runs in a folder of its own. Without arguments the notebooks are written back with their outputs, and their pages
with pictures as files; with the name of a folder they are only run, and written there.

  make notebooks
"""

from __future__ import annotations

import base64
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
SOURCE, PAGES = ROOT / "examples" / "notebooks", ROOT / "docs" / "notebooks"


def main() -> None:
    """Run all notebooks."""
    import nbclient
    import nbformat

    target = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    for path in sorted(SOURCE.glob("*.ipynb")):
        book = nbformat.reads(path.read_text(encoding="utf-8"), as_version=4)
        with tempfile.TemporaryDirectory() as folder:
            nbclient.NotebookClient(book, timeout=300, resources={"metadata": {"path": folder}}).execute()
        for cell in book.cells:
            cell.metadata = {}
        book.metadata = {"kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"}}
        text = json.dumps(book, indent=1, ensure_ascii=False, sort_keys=True) + "\n"
        ((target or SOURCE) / path.name).write_text(text, encoding="utf-8")
        write_page(path.stem, json.loads(text), target or PAGES)


def write_page(name: str, book: Any, folder: Path) -> None:
    """Write a notebook that has run as Markdown, its pictures beside it."""
    parts, pictures = [], 0
    for cell in book["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            data = output.get("data", {})
            if "image/png" in data:
                pictures += 1
                place = f"{name.replace('_', '-')}-{pictures}.png"
                (folder / place).write_bytes(base64.b64decode("".join(data["image/png"])))
                parts.append(f"![Output of the cell above]({place})")
            else:
                text = "".join(output.get("text") or data.get("text/plain", ""))
                parts.append(f"```text\n{text.rstrip()}\n```")
    origin = f"<!-- written by scripts/notebooks.py from examples/notebooks/{name}.ipynb -->"
    page = "\n\n".join([parts[0], origin, *parts[1:]]) + "\n"
    (folder / f"{name.replace('_', '-')}.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
