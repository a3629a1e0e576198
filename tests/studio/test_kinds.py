"""What a file of a session is taken for."""

from __future__ import annotations

from pathlib import Path

import pytest

from dynident.studio.folder import kind_of


@pytest.mark.parametrize(
    ("name", "text", "kind"),
    [
        ("a.usda", "#usda 1.0\n", "robot"),
        ("a.usdc", "PXR-USDC", "robot"),
        ("a.urdf.xacro", '<robot name="a" xmlns:xacro="x"/>', "robot"),
        ("a.sdf", '<?xml version="1.0"?><sdf version="1.9"/>', "robot"),
        ("a.urdf", "<?xml version='1.0'?><robot name='x'/>", "robot"),
        ("a.xml", "<mujoco/>", "robot"),
        ("b.xml", "<page/>", "other"),
        ("a.yaml", "case: 1\nrobot: er16\n", "case"),
        ("b.yaml", "case: 1\nrobot: [er16\n", "case"),
        ("c.yaml", "joints:\n  - name: a\n", "robot"),
        ("d.yaml", "x: 1\n", "other"),
        ("a.json", '{"kind": "dynident plan"}', "plan"),
        ("b.json", '{"kind": "dynident estimate"}', "estimate"),
        ("c.json", "{}", "other"),
        ("a.csv", "t,q1\n0,1\n", "log"),
        ("a.html", "", "report"),
        ("a.STL", "", "mesh"),
        ("a", "", "other"),
    ],
)
def test_the_kind_of_a_file(name: str, text: str, kind: str, tmp_path: Path) -> None:
    place = tmp_path / name
    place.write_text(text, encoding="utf-8")
    facts = place.stat()
    assert kind_of(place, facts.st_mtime_ns, facts.st_size) == kind
