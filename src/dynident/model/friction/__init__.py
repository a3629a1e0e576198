"""Friction and drive terms, a family: one part per file, each a block of regressor columns."""

from contextlib import suppress

from dynident.errors import BrokenPart
from dynident.model.friction.base import WHOLE, Coefficient, Friction, Motion, SharedUse
from dynident.plugins import Family

FRICTION: Family[Friction] = Family("dynident.model.friction", Friction, "friction model")  # type: ignore[type-abstract]


def shared_parts() -> tuple[tuple[str, SharedUse], ...]:
    """Return the names of the parts that stand in lists for all drives, and their use there, in their order."""
    found: list[tuple[str, SharedUse]] = []
    for name in FRICTION.names():
        with suppress(BrokenPart):  # of a package: whoever asks for it by name is told
            found += [(name, use) for use in (FRICTION.get(name).shared,) if use is not None]
    return tuple(sorted(found, key=lambda each: each[1].place))


def default_friction() -> tuple[str, ...]:
    """Return the names of the parts of a model whose friction is not stated."""
    return tuple(name for name, use in shared_parts() if use.group == "default")


__all__ = ["FRICTION", "WHOLE", "Coefficient", "Friction", "Motion", "SharedUse", "default_friction", "shared_parts"]
