"""The figures of the structure of the source, of a small package that has one of each."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from loaded_file import loaded_file


@pytest.fixture(scope="module")
def sizes() -> ModuleType:
    return loaded_file("scripts/sizes.py")


def test_figures_of_a_small_package(sizes: ModuleType, tmp_path: Path) -> None:
    files = {
        "plugins.py": "class Family: ...\n",
        "low/__init__.py": "",
        "low/parts/__init__.py": "from house.plugins import Family\n"
        "PARTS = Family[int]('house.low.parts', int, 'part')\n",
        "low/parts/one.py": "class One: ...\n",
        "low/parts/_shared.py": "class One: ...\n",
        "low/first.py": "def f(a, b, c, d, e, f, g, h, *, i=0, **more):\n"
        "    from house.low import second\n    return second\n",
        "low/second.py": "from ..low.parts import PARTS\nfrom house.low.first import f\n",
        "high/__init__.py": "from house.low.first import f\n",
        "high/third.py": "class T:\n    def m(self, a, b, c, d, e, f, g, h):\n" + "        a += 1\n" * 60,
    }
    for name, text in files.items():
        (tmp_path / "house" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "house" / name).write_text(text)
    numbers = sizes.figures(tmp_path / "house")
    assert numbers["circles of rooms"] == ["low/first low/second"] and numbers["rooms in circles"] == 2
    small = [one.split()[0] for one in numbers["files under 60 lines, no parts and no __init__"]]
    assert small == ["low/first.py", "low/parts/_shared.py", "low/second.py", "plugins.py"]
    assert numbers["functions with more than 8 parameters"] == ["low/first.py:1 f 9"]
    assert numbers["functions with **kwargs"] == ["low/first.py:1 f"]
    assert numbers["functions over 60 lines"] == ["high/third.py:2 m 61"]
    assert [one.split(":")[0] for one in numbers["class names that are defined twice"]] == ["One"]
    assert numbers["files"] == 9 and numbers["statements"] == 76
    assert numbers["lines by wing"] == {"(outside)": 1, "high": 63, "low": 9}
    assert sizes.core(numbers, ["low"], ["low/second"]) == {"low": 7}
    with pytest.raises(ValueError, match="'lower'"):
        sizes.core(numbers, ["lower"], [])
