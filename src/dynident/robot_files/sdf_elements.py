"""Elements of an SDF as values: poses, joints, inertials, limits and shapes, each checked.

A mistyped attribute or element is refused by name and not passed over.
Source: the schema of SDFormat, versions 1.4 to 1.12 (``sdf/1.12/*.sdf`` of gazebosim/sdformat). Elements and attributes
with a namespace prefix (``drake:``, ``gz:``) are the user's own and valid everywhere, as are ``<plugin>`` and
``<sensor>``. In an element that is not read, nothing is checked.

A mistyped attribute or element is refused by name and not passed over.
Source: the schema of SDFormat, versions 1.4 to 1.12 (``sdf/1.12/*.sdf`` of gazebosim/sdformat). Elements and attributes
with a namespace prefix (``drake:``, ``gz:``) are the user's own and valid everywhere, as are ``<plugin>`` and
``<sensor>``. In an element that is not read, nothing is checked.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal

import numpy as np

from dynident.arrays import Array
from dynident.errors import DescriptionError, nearest
from dynident.model.documents.numbers import check_name, check_order, shown
from dynident.model.inertia import Inertia
from dynident.model.joint import Drive, JointLimits, Mimic
from dynident.model.shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere
from dynident.robot_files.rotations import rotation_from_quaternion, rotation_from_rpy
from dynident.robot_files.xml_elements import Element, Values

Pose = tuple[Array, Array]
JointKind = Literal["fixed", "revolute", "prismatic"]

KINDS: Final[Mapping[str, JointKind]] = {
    "revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "fixed": "fixed",
}  # fmt: skip
_UNREAD: Final = ("ball", "screw", "universal", "gearbox", "revolute2")
_TENSOR: Final = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_KNOWN: Final = ((1, 4), (1, 12))
_NONE: Final = 1e16  # what the format writes where there is no limit


def version_of(root: Element) -> tuple[int, int]:
    """Return the version of the format that a file states."""
    text = Values(root.place, root.attributes).text("version", "1.12")
    parts = text.split(".")
    if len(parts) != 2 or not all(part.isascii() and part.isdigit() and len(part) < 4 for part in parts):
        raise root.place.error(f"version {shown(text)} is no version of SDF", 'write version="1.7"')
    return int(parts[0]), int(parts[1])


def version_note(root: Element) -> str:
    """Return what is to be said of the version that a file states; empty where it is one of those that are known."""
    if "version" not in root.attributes:
        return "no version is stated, which SDFormat requires: read as 1.12"
    version = version_of(root)
    if _KNOWN[0] <= version <= _KNOWN[1]:
        return ""
    nearest_one = _KNOWN[0] if version < _KNOWN[0] else _KNOWN[1]
    return f"version {root.attributes['version']} is not known: read as {nearest_one[0]}.{nearest_one[1]}"


def name_of(element: Element) -> str:
    """Return the name of an element."""
    return check_name(element.place, f"{element.tag} name", Values(element.place, element.attributes).text("name"))


def model_pose(model: Element) -> Pose:
    """Return where a model stands in the world."""
    poses = model.all("pose")
    if poses and poses[0].attributes.get("relative_to"):
        raise poses[0].place.error("the model stands in a frame of the world", "write its pose in the world")
    return pose_of_element(poses[0]) if poses else (np.eye(3), np.zeros(3))


def pose_of_element(element: Element) -> Pose:
    """Return rotation and position that a ``<pose>`` writes, angles or a quaternion."""
    values = Values(element.place, element.attributes)
    form = values.choice("rotation_format", ("euler_rpy", "quat_xyzw"), "euler_rpy")
    if not element.text:
        return np.eye(3), np.zeros(3)
    if form == "quat_xyzw":
        numbers = numbers_in(element, 7)
        length = float(np.linalg.norm(numbers[3:]))
        if abs(length - 1.0) > 1e-3:
            evidence = f"the quaternion has length {length:.4g}, not 1"
            raise element.place.error(evidence, "write a unit quaternion x y z w")
        x, y, z, w = numbers[3:] / length
        return rotation_from_quaternion([w, x, y, z]), numbers[:3]
    numbers = numbers_in(element, 6)
    in_degrees = values.choice("degrees", ("true", "false", "1", "0"), "false") in ("true", "1")
    unit = float(np.pi / 180.0) if in_degrees else 1.0
    return rotation_from_rpy(unit * numbers[3:]), numbers[:3]


def placed(outer: Pose, inner: Pose) -> Pose:
    """Return where a pose in a frame is in the frame of the frame."""
    return outer[0] @ inner[0], outer[1] + outer[0] @ inner[1]


def numbers_in(element: Element, count: int) -> Array:
    """Return the numbers in an element, shape (count,)."""
    return Values(element.place, {"the value": element.text}).numbers("the value", count)


def number_in(parent: Element, tag: str, default: float) -> float:
    """Return the number in a child, ``default`` where there is none."""
    found = parent.all(tag)
    return Values(found[0].place, {tag: found[0].text}).number(tag) if found else default


def only_child(parent: Element, tag: str, step: str) -> Element:
    """Return the one child of a name; errors advise ``step``."""
    found = parent.all(tag)
    if len(found) != 1:
        raise parent.place.error(f"{len(found)} <{tag}> in <{parent.tag}>", step)
    return found[0]


def kind_of_joint(joint: Element) -> JointKind:
    """Return what a joint is; a continuous one is revolute."""
    word = Values(joint.place, joint.attributes).text("type")
    if word in _UNREAD:
        step = "replace it by revolute and prismatic joints, or by a fixed one"
        raise joint.place.error(f"type {shown(word)} is not read", step)
    if word not in KINDS:
        step = f"choose one of: {', '.join(KINDS)}{nearest(word, KINDS)}"
        raise joint.place.error(f"type {shown(word)} is not known", step)
    return KINDS[word]


def inertia_of_link(link: Element) -> tuple[Inertia | None, str]:
    """Return the inertia of a link about its frame, and which of its parts is missing.

    It is None where the file has none, or not all of it: SDFormat has 1 kg and 1 kg m^2 there, which no one measured.
    """
    if not link.all("inertial"):
        return None, ""
    inertial = only_child(link, "inertial", "keep one of them")
    if inertial.attributes.get("auto", "false") in ("true", "1"):
        raise inertial.place.error('auto="true" computes it from shapes', "write <mass> and <inertia>")
    poses = inertial.all("pose")
    if poses and poses[0].attributes.get("relative_to"):
        raise poses[0].place.error("an inertial has its pose in its link", "write it there, without relative_to")
    rotation, centre = pose_of_element(poses[0]) if poses else (np.eye(3), np.zeros(3))
    for tag in ("mass", "inertia"):
        if not inertial.all(tag):
            return None, tag
    only_child(inertial, "mass", "write one <mass>, in kg")
    mass = number_in(inertial, "mass", 0.0)
    if mass < 0.0:
        raise inertial.place.error(f"mass {mass:g} is negative", "write the mass in kg, 0 or more")
    holder = only_child(inertial, "inertia", "write one <inertia> with <ixx>, <iyy>, <izz>")
    for tag in ("ixx", "iyy", "izz"):
        only_child(holder, tag, f"write one <{tag}>")
    ixx, ixy, ixz, iyy, iyz, izz = (number_in(holder, tag, 0.0) for tag in _TENSOR)
    tensor = np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
    return Inertia.from_centre_of_mass(mass, centre, rotation @ tensor @ rotation.T), ""


def limits_of_joint(joint: Element, holder: Element) -> JointLimits:
    """Return the limits of a joint with its ``<axis>``."""
    found = holder.all("limit")
    if not found:
        return JointLimits()
    lower, upper = (_bound(found[0], tag, sign) for tag, sign in (("lower", -1.0), ("upper", 1.0)))
    if joint.attributes.get("type") == "continuous":
        lower, upper = -np.inf, np.inf
    check_order(found[0].place, lower, upper)
    effort, velocity = (number_in(found[0], tag, -1.0) for tag in ("effort", "velocity"))
    return JointLimits(
        lower, upper, velocity=velocity if velocity >= 0 else np.inf, effort=effort if effort >= 0 else np.inf
    )


def _bound(limit: Element, tag: str, sign: float) -> float:
    found = limit.all(tag)
    if not found or found[0].text.lower() in ("inf", "-inf", "+inf"):
        return sign * np.inf
    value = number_in(limit, tag, 0.0)
    return value if abs(value) < _NONE else sign * np.inf


def drive_of_joint(joint: Element) -> Drive:
    """Return the rotor inertia and gear ratio that Drake's own elements state."""
    rotor, gear = number_in(joint, "drake:rotor_inertia", 0.0), number_in(joint, "drake:gear_ratio", 1.0)
    if rotor < 0.0 or gear == 0.0:
        raise joint.place.error("a negative rotor inertia, or a gear ratio of 0", "correct drake:rotor_inertia")
    return Drive(gear, rotor)


def mimic_of(joint: Element, holder: Element, scope: str) -> Mimic | None:
    """Return which joint a joint with its ``<axis>`` follows: as SDFormat writes it, or Drake in an element of its own.

    SDFormat: q = multiplier * (q of the leader - reference) + offset; Drake: q = multiplier * q of the leader + offset.
    """
    found: list[tuple[Element, Mimic]] = []
    for element in holder.all("mimic"):
        values = Values(element.place, element.attributes)
        if values.choice("axis", ("axis", "axis2"), "axis") == "axis2":
            raise element.place.error("it follows a second axis", "write the joint of one axis that it follows")
        only_child(element, "multiplier", "write one <multiplier>")
        multiplier, offset, reference = (number_in(element, tag, 0.0) for tag in ("multiplier", "offset", "reference"))
        found.append((element, Mimic(scope + values.name("joint"), multiplier, offset - multiplier * reference)))
    for element in joint.all("drake:mimic"):
        values = Values(element.place, element.attributes).known(("joint", "multiplier", "offset"))
        mimic = Mimic(scope + values.name("joint"), values.number("multiplier"), values.number("offset"))
        found.append((element, mimic))
    for element, mimic in found:
        if mimic.multiplier == 0.0:
            step = "make the joint fixed, or correct the multiplier"
            raise element.place.error("multiplier 0 holds it still", step)
        if mimic != found[0][1]:
            raise element.place.error("the joint follows otherwise by another element too", "keep one of the two")
    return found[0][1] if found else None


def visual_of(visual: Element) -> Shape | None:
    """Return the shape of a ``<visual>`` in the frame of its link; None for a faulty one: nothing moves by it."""
    try:
        return shape_of(visual)
    except DescriptionError:
        return None


def shape_of(collision: Element) -> Shape | None:
    """Return the shape of a ``<collision>`` in the frame of its link; None for one that has no place here."""
    poses, holders = collision.all("pose"), collision.all("geometry")
    if poses and poses[0].attributes.get("relative_to"):
        return None  # of a shape only: no torque has it
    rotation, translation = pose_of_element(poses[0]) if poses else (np.eye(3), np.zeros(3))
    for element in holders[0].children if holders else ():
        if element.tag in ("box", "ellipsoid"):
            size = numbers_in(only_child(element, "size" if element.tag == "box" else "radii", "write it"), 3)
            size = size if element.tag == "box" else 2.0 * size  # an ellipsoid lies in its box
            _check_size(element, size)
            return Box(size, rotation, translation)
        if element.tag in ("sphere", "cylinder", "capsule"):
            return _round(element, rotation, translation)
        if element.tag == "mesh":
            scale = numbers_in(element.all("scale")[0], 3) if element.all("scale") else np.ones(3)
            uri = only_child(element, "uri", "write the <uri> of its file").text
            return Mesh(uri, scale, rotation, translation) if uri and np.all(scale != 0.0) else None
    return None


def _round(element: Element, rotation: Array, translation: Array) -> Shape:
    sizes = np.array([number_in(element, "radius", 0.5), number_in(element, "length", 1.0)])
    _check_size(element, sizes)
    if element.tag == "sphere":
        return Sphere(sizes[0], translation)
    if element.tag == "cylinder":
        return Cylinder(sizes[0], sizes[1], rotation, translation)
    tip = 0.5 * sizes[1] * rotation[:, 2]
    return Capsule(translation - tip, translation + tip, sizes[0])


def _check_size(element: Element, sizes: Array) -> None:
    if np.any(sizes <= 0.0):
        raise element.place.error(f"a size of the {element.tag} is not above 0", "write lengths in m")


#: Attributes of each element that is read; an element that is not here has none.
_ATTRIBUTES: Final[Mapping[str, tuple[str, ...]]] = {
    "sdf": ("version",),
    "world": ("name", "namespace"),
    "model": ("name", "canonical_link", "placement_frame", "namespace"),
    "frame": ("name", "attached_to"),
    "link": ("name",),
    "joint": ("name", "type"),
    "collision": ("name",),
    "inertial": ("auto",),
    "pose": ("relative_to", "rotation_format", "degrees", "frame"),
    "xyz": ("expressed_in",),
    "mimic": ("joint", "axis"),
    "mesh": ("optimization",),
    "include": ("merge",),
}

#: Elements that are read in each element.
_READ: Final[Mapping[str, tuple[str, ...]]] = {
    "sdf": ("world", "model", "include"),
    "world": ("gravity", "model", "include"),
    "model": ("pose", "frame", "link", "joint", "model", "include", "static"),
    "include": ("uri", "name", "pose", "placement_frame", "static"),
    "frame": ("pose",),
    "link": ("pose", "inertial", "collision", "gravity"),
    "inertial": ("pose", "mass", "inertia"),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "joint": ("pose", "parent", "child", "axis"),
    "axis": ("xyz", "use_parent_model_frame", "dynamics", "limit", "mimic"),
    "dynamics": ("damping", "friction", "spring_reference", "spring_stiffness"),
    "limit": ("lower", "upper", "effort", "velocity", "stiffness", "dissipation"),
    "mimic": ("multiplier", "offset", "reference"),
    "collision": ("pose", "geometry"),
    "geometry": ("box", "sphere", "cylinder", "capsule", "ellipsoid", "mesh"),
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "ellipsoid": ("radii",),
    "mesh": ("uri", "scale"),
}

#: Elements of the format that have no part in the model here, with all that is in them.
_PASSED_OVER: Final[Mapping[str, str]] = {
    "sdf": "actor light",
    "world": "audio wind magnetic_field atmosphere gui physics scene light frame joint actor road state "
    "population spherical_coordinates",
    "model": "self_collide allow_auto_disable enable_wind gripper model_state origin",
    "link": "enable_wind self_collide kinematic must_be_base_link velocity_decay frame visual projector "
    "audio_sink audio_source battery light particle_emitter damping origin",
    "inertial": "frame density auto_inertia_params fluid_added_mass origin",
    "joint": "frame gearbox_ratio gearbox_reference_body thread_pitch screw_thread_pitch axis2 physics origin",
    "axis": "initial_position",
    "collision": "frame laser_retro max_contacts density auto_inertia_params surface origin",
    "geometry": "empty cone heightmap image plane polyline",
    "mesh": "submesh convex_decomposition",
}
#: Elements of Drake that are read, in a joint, and how like one of them a mistyped one is.
_OF_DRAKE: Final = ("drake:rotor_inertia", "drake:gear_ratio", "drake:mimic")
_ALIKE: Final = 0.85
#: Those in a model that are not read, with why not and what to do.
_REFUSED: Final[Mapping[str, tuple[str, str]]] = {
    "drake:joint": ("a planar joint is not read", "replace it by revolute and prismatic joints, or by a fixed one"),
    "drake:ball_constraint": ("it closes a loop of links", "remove it: only trees are read"),
}
#: Those in a model that add a force, which the note of the robot names.
SPRINGS_OF_DRAKE: Final = ("drake:linear_spring_damper", "drake:linear_bushing_rpy", "drake:tendon_constraint")
_EVERYWHERE: Final = ("plugin", "sensor")


def check_words(element: Element) -> None:
    """Check the attributes and elements of an element that is read, and of those in it.

    Raises:
        DescriptionError: One is unknown; the message has the nearest known one.
    """
    tag = element.tag
    own = {name: text for name, text in element.attributes.items() if ":" not in name and name != "xmlns"}
    Values(element.place, own).known(_ATTRIBUTES.get(tag, ()))
    if own.get("frame"):
        step = 'write relative_to="..." and version="1.7" or later, or remove it'
        raise element.place.error("a pose in a frame by the attribute 'frame' is not read", step)
    read = _READ.get(tag, ())
    known = (*read, *_PASSED_OVER.get(tag, "").split(), *_EVERYWHERE)
    for child in element.children:
        if child.tag in read:
            check_words(child)
        elif ":" in child.tag:
            _check_prefixed(child, tag)
        elif child.tag not in known:
            evidence = f"unknown element <{child.tag}> in <{tag}>"
            raise child.place.error(evidence, f"remove or correct it{nearest(child.tag, known)}")


def _check_prefixed(element: Element, parent: str) -> None:
    """Refuse an element of Drake that moves otherwise, or stands elsewhere; others are the user's own."""
    if element.tag in _REFUSED and parent == "model":
        raise element.place.error(*_REFUSED[element.tag])
    if element.tag in _OF_DRAKE and parent != "joint":
        raise element.place.error(f"<{element.tag}> in <{parent}>", "write it in the <joint>")
    if element.tag not in _OF_DRAKE and (near := nearest(element.tag, _OF_DRAKE, _ALIKE)):
        raise element.place.error(f"unknown element <{element.tag}> in <{parent}>", f"remove or correct it{near}")
