"""The attributes and elements of an SDF, so that a mistyped one is refused by name and not passed over.

Source: the schema of SDFormat, versions 1.4 to 1.12 (``sdf/1.12/*.sdf`` of gazebosim/sdformat). Elements and attributes
with a namespace prefix (``drake:``, ``gz:``) are the user's own and valid everywhere, as are ``<plugin>`` and
``<sensor>``. In an element that is not read, nothing is checked.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from dynident.errors import nearest
from dynident.robot_files.xml_elements import Element
from dynident.robot_files.xml_values import Values

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
