"""The verbs of payload, monitor, track and simulate have the defaults of their commands, which ask them."""

from __future__ import annotations

import argparse
import inspect
from collections.abc import Callable
from dataclasses import fields
from importlib import import_module
from typing import Any

import pytest

from dynident.api.applications import monitor, payload, track
from dynident.api.simulate import simulate_case
from dynident.applications.payload import BeforeRun
from dynident.applications.tracking import Pace


def command_defaults(command: str) -> dict[str, Any]:
    parser = argparse.ArgumentParser()
    import_module(f"dynident.cli.{command}").configure(parser)
    return {action.dest: action.default for action in parser._actions}


def fields_of(kind: type) -> dict[str, Any]:
    return {field.name: field.default for field in fields(kind)}


@pytest.mark.parametrize(
    ("command", "verb", "values", "renamed"),
    [
        ("payload", payload, BeforeRun, {"mass_std": "mass_deviation", "gain_std": "gain_deviation"}),
        ("monitor", monitor, None, {"rate": "rates"}),
        ("track", track, Pace, {}),
        ("simulate", simulate_case, None, {}),
    ],
)
def test_command_and_verb_have_one_set_of_defaults(
    command: str, verb: Callable[..., Any], values: type | None, renamed: dict[str, str]
) -> None:
    own = {name: one.default for name, one in inspect.signature(verb).parameters.items()}
    own |= fields_of(values) if values else {}
    compared = 0
    for name, default in command_defaults(command).items():
        known = renamed.get(name, name)
        if known in own and own[known] is not inspect.Parameter.empty:
            assert own[known] == (float(default) if name == "rate" else default), name
            compared += 1
    assert compared >= 2
