"""Models, preprocessing and maps of columns as plain data, and back; estimate files and triangle files hold them so."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from dynident.data.formats import ColumnMap, Units
from dynident.data.preprocessing import FILTERS, Preprocessing
from dynident.model.documents.robot_data import robot_from_dict, robot_to_dict
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import FRICTION


def model_to_dict(model: DynamicModel) -> dict[str, Any]:
    """Return a model as plain data: robot and friction."""
    friction = [{FRICTION.name_of(part): _options(part)} for part in model.friction]
    return {"robot": robot_to_dict(model.robot), "friction": friction}


def model_from_dict(data: Mapping[str, Any], path: object) -> DynamicModel:
    """Return the model in plain data; errors are those of its parts, ``path`` is the file for messages."""
    friction = tuple(
        FRICTION.make(name, {key: _tuples(value) for key, value in options.items()})
        for item in data["friction"]
        for name, options in item.items()
    )
    return DynamicModel(robot_from_dict(data["robot"], str(path)), friction)


def preprocessing_to_dict(how: Preprocessing) -> dict[str, Any]:
    """Return a preprocessing as plain data."""
    rest = {f.name: getattr(how, f.name) for f in fields(how) if f.name != "filter"}
    return {"filter": {FILTERS.name_of(how.filter): _options(how.filter)}, **rest}


def preprocessing_from_dict(data: Mapping[str, Any]) -> Preprocessing:
    """Return the preprocessing in plain data; errors are those of its parts."""
    ((kind, options),) = data["filter"].items()
    return Preprocessing(filter=FILTERS.make(kind, options), **{k: v for k, v in data.items() if k != "filter"})


def columns_from_dict(data: Mapping[str, Any]) -> ColumnMap:
    """Return the map of columns in plain data; errors are those of :class:`ColumnMap`."""
    columns = {name: _tuples(value) for name, value in data.items()}
    units: Any = {name: _tuples(value) for name, value in data["units"].items()}
    columns["units"] = Units(**units)
    return ColumnMap(**columns)


def _options(part: Any) -> dict[str, Any]:
    return {f.name: getattr(part, f.name) for f in fields(part)}


def _tuples(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
