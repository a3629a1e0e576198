"""What is fuzzed: a name, sound files to begin with, and the reader that has to take or to refuse anything."""

from __future__ import annotations

import ast
import json
import shutil
import zlib
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from fuzz.seeds import BALL, CASE, DH, HAND, JOINTS, MAKERS, ONE

Read = Callable[[Path], object]

#: Words that a change puts into files of text, beside those of :mod:`fuzz.mutations`.
_XML = (
    "<!DOCTYPE r [<!ENTITY a 'b'>]>",
    "&a;",
    "<link name='x'/>",
    "xacro:include",
    "${1+1}",
    "<mesh filename='../x'/>",
)
_MJCF = (
    "equality='disable'",
    "vertex='0 0 0'",
    "joint='a'",
    "<include file='../x'/>",
    "<frame/>",
    "<replicate count='9'/>",
    "class='main'",
    "<geom size='.1'/>",
    "0 0 0 0",
    "<freejoint/>",
    "mocap='true'",
    "<tendon tendon1='t'/>",
)
_SDF = (
    "relative_to='upper'",
    "attached_to='mount'",
    "world",
    "__model__",
    "<include/>",
    "hand::palm",
    "version='1.4'",
    "<include><uri>hand.sdf</uri></include>",
    "canonical_link='upper'",
    "placement_frame='upper'",
    "merge='true'",
    "<drake:mimic joint='a' multiplier='2' offset='0'/>",
    "<mimic joint='a'><multiplier>2</multiplier></mimic>",
    "hand::__model__",
)
_USD = (
    "nan",
    "inf",
    "(0, 0, 0)",
    "rel physics:body0",
    "</arm/upper>",
    "over",
    "class",
    "metersPerUnit = 0",
    "None",
    "[]",
)
_XACRO = (
    "${half}",
    "$(arg mass)",
    "$(find dynident)",
    "$(eval 1)",
    "$(cwd)",
    "$$",
    "<xacro:insert_block name='origin'/>",
    "<xacro:ball/>",
    "<xacro:call macro='ball'/>",
    "<xacro:element xacro:name='link'/>",
    "<xacro:attribute name='a' value='b'/>",
    "scope='parent'",
    "^|",
    "**origin",
    "xacro.load_yaml('ball.xacro')",
    "\\ud800",
    "default=''",
)
_YAML = ("&a [*a]", "*a", "!!python/object:os.system", "{<<: *a}", "- - - -", "? ", "%TAG ! !", "~", "auto", "case: 1")
_TEXT = ("#", '"', ",,", ";", "\t", "\ufeff", "nan", "inf", "0x10", "1_000", "1,5", "=1+1", "EOF", "Name")


@dataclass(frozen=True)
class Target:
    """A reader under test.

    Attributes:
        suffix: End of the names of the files.
        kind: What is mutated: ``text``, ``json``, ``zip`` or ``bytes``.
        read: Reads one file; raises a DynidentError or succeeds.
        words: Words of its language.
        beside: Files that lie beside the one under test, by name.
        instrument: Packages whose branches a coverage-guided run counts.
        warm: Called once before the first execution.
    """

    suffix: str
    kind: str
    read: Read
    words: tuple[str, ...] = ()
    beside: Mapping[str, str] | None = None
    instrument: tuple[str, ...] = ("dynident.data.formats",)
    warm: Callable[[], None] | None = None

    def prepare(self, folder: Path, name: str) -> list[bytes]:
        """Return the contents of the sound files and put the files beside them into the folder."""
        if self.warm:
            self.warm()
        place = folder / "seeds"
        place.mkdir()
        contents = [path.read_bytes() for path in MAKERS[name](place)]
        shutil.rmtree(place)
        for file, text in (self.beside or {}).items():
            (folder / file).write_text(text)
        return contents


def _robot(path: Path) -> object:
    from dynident.robot_files import read_robot

    return read_robot(path)


def _of_format(name: str) -> Read:
    """Return the reader of one format of robot models, whatever a file looks like: no xacro is expanded."""

    def read(path: Path) -> object:
        from dynident.robot_files.formats.base import DESCRIPTIONS

        return DESCRIPTIONS.make(name).read(path, path.read_bytes())

    return read


def _xacro(path: Path) -> object:
    """Expand in this process, as the child of :mod:`dynident.robot_files.xacro` does, and read the URDF."""
    from dynident.robot_files.formats.urdf import read_urdf
    from dynident.robot_files.xacro import answered
    from dynident.robot_files.xacro_child import expanded

    answer = json.loads(json.dumps(expanded(str(path), {}, {})))
    return read_urdf(path, answered(answer, {}).data)


def _case(path: Path) -> object:
    from dynident.case.case import read_case

    return read_case(path).model


@cache
def _columns(**options: Any) -> Any:
    from dynident.data.formats import ColumnMap

    return ColumnMap(**options)


def _log(path: Path) -> object:
    from dynident.data.formats import read_log

    return read_log(path, _columns(optional=("dq", "torque")))


def _blocks(path: Path) -> object:
    """Read whole or in blocks, as the content decides: both ways have to refuse damage by name."""
    from dynident.data.formats import stream_log

    if zlib.crc32(path.read_bytes()) % 2:
        return _log(path)
    return list(stream_log(path, _columns()).blocks(7))


def _bag(path: Path) -> object:
    from dynident.data.formats import read_log

    q, torque = (tuple(f"{joint}.{word}" for joint in JOINTS) for word in ("position", "effort"))
    return read_log(path, _columns(joints=JOINTS, q=q, torque=torque))


def _header_once() -> None:
    """Let NumPy parse the header of an array once per text: a triangle file has two dozen."""
    ast.literal_eval = lru_cache(1000)(ast.literal_eval)


def _define_once() -> None:
    """Let rosbags parse and compile message definitions once per text: that is most of its time else."""
    import importlib

    @lru_cache(1000)
    def made(text: str, name: str) -> dict[str, Any]:
        scope: dict[str, Any] = {"__name__": name}
        exec(compile(text, "<definitions>", "exec", dont_inherit=True), scope)
        return scope

    def once(text: str, scope: dict[str, Any]) -> None:
        scope.update(made(text, scope["__name__"]))

    anyreader: Any = importlib.import_module("rosbags.highlevel.anyreader")
    anyreader.get_types_from_msg = lru_cache(1000)(anyreader.get_types_from_msg)
    anyreader.get_types_from_idl = lru_cache(1000)(anyreader.get_types_from_idl)
    storage: Any = importlib.import_module("rosbags.rosbag2.storage_sqlite3")
    quality, once_parsed = storage.parse_qos, lru_cache(1000)(storage.parse_qos)
    storage.parse_qos = lambda found: (once_parsed if isinstance(found, str) else quality)(found)
    for name in ("rosbags.serde.utils", "rosbags.typesys.store"):
        compiling: Any = importlib.import_module(name)
        compiling.exec = once
    store: Any = importlib.import_module("rosbags.typesys.store").Typestore
    register = store.register
    parsers: OrderedDict[str, dict[str, Any]] = OrderedDict()  # what a store has compiled, by its definitions

    def registered(self: Any, types: Any) -> None:
        register(self, types)
        self.cache = parsers.setdefault(repr(self.fielddefs), {})
        if len(parsers) > 200:
            parsers.popitem(last=False)

    store.register = registered


def _scope(path: Path) -> object:
    from dynident.data.formats import read_log
    from dynident.data.formats.twincat_scope import TwincatScope

    return read_log(path, _columns(joints=("a",), q=("q1",), torque=("tau1",)), form=TwincatScope())


def _plan(path: Path) -> object:
    from dynident.excitation.design.plan import read_plan

    return read_plan(path)


def _estimate(path: Path) -> object:
    from dynident.identification.files.estimate_file import read_estimate

    return read_estimate(path)


def _triangles(path: Path) -> object:
    from dynident.identification.streaming.triangle_file import read_digest

    return read_digest(path)


_MODEL = ("dynident.robot_files", "dynident.model.documents", "dynident.model.friction")
_SAVED = ("dynident.identification.files.saved_values", "dynident.data.preprocessing", *_MODEL)

TARGETS: Mapping[str, Target] = {
    "urdf": Target(".urdf", "text", _of_format("urdf"), _XML, instrument=_MODEL),
    "xacro": Target(".xacro", "text", _xacro, (*_XML, *_XACRO), {"ball.xacro": BALL}, instrument=("xacro", *_MODEL)),
    "mjcf": Target(
        ".xml", "text", _of_format("mjcf"), (*_XML, *_MJCF), instrument=(*_MODEL, "dynident.robot_files.mjcf")
    ),
    "sdf": Target(".sdf", "text", _of_format("sdf"), (*_XML, *_SDF), {"hand.sdf": HAND}, instrument=_MODEL),
    "usd": Target(".usda", "text", _of_format("usd"), _USD, instrument=_MODEL),
    "dh": Target(".yaml", "text", _robot, _YAML, instrument=_MODEL),
    "robot_json": Target(".json", "json", _robot, instrument=_MODEL),
    "case": Target(
        ".yaml",
        "text",
        _case,
        (*_YAML, "robot: dh.yaml", "prior: arm.urdf", "workspace: {}", "cell: {}", "friction: auto", "split: 0.5"),
        {"arm.urdf": ONE, "dh.yaml": DH, "other.yaml": CASE},
        ("dynident.case", "dynident.data.preprocessing", *_MODEL),
    ),
    "csv": Target(".csv", "text", _blocks, _TEXT),
    "twincat": Target(".csv", "text", _scope, _TEXT),
    "npz": Target(".npz", "zip", _blocks, warm=_header_once),
    "parquet": Target(".parquet", "bytes", _blocks),
    "mat": Target(".mat", "bytes", _blocks),
    "bag1": Target(".bag", "bytes", _bag, warm=_define_once),
    "db3": Target(".db3", "bytes", _bag, warm=_define_once),
    "mcap": Target(".mcap", "bytes", _bag, warm=_define_once),
    "plan": Target(".json", "json", _plan, instrument=("dynident.excitation.design.plan",)),
    "estimate": Target(".json", "json", _estimate, instrument=("dynident.identification.files.estimate_file", *_SAVED)),
    "triangles": Target(
        ".tri",
        "zip",
        _triangles,
        instrument=("dynident.identification.streaming.triangle_file", *_SAVED),
        warm=_header_once,
    ),
}
