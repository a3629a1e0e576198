"""Base parameters as mathematics: symbols in italics, their indices and owners below the line."""

from __future__ import annotations

import re

import numpy as np
from markupsafe import Markup, escape

from dynident.model.base_parameters import BaseParameters
from dynident.model.parameters import Parameter
from dynident.results.text import format_given, label

#: A capital with indices, such as Izz, Fc+ or F0; first moments mx, my, mz and the mass m are names as they are.
_INDEXED = re.compile(r"([A-Z])([A-Za-z0-9+-]{1,4})")

#: Letters of an owner's name from which on a term may break inside.
_LONGEST = 24

#: Signs of the terms; a blank that does not break keeps them with their term.
_PLUS, _MINUS, _KEPT = "+", "\u2212", "\u00a0"


def combination(base: BaseParameters, row: int) -> Markup:
    """Return a base parameter as markup that may break between its terms; its plain name stands in its title.

    Args:
        base: The base parameters.
        row: Which one.
    """
    lead = int(base.independent[row])
    terms = [_term("", base.parameters[lead])]
    for k in np.flatnonzero(base.matters[row]):
        value = float(base.matrix[row, k])
        if k != lead:
            size = "" if np.isclose(abs(value), 1.0, rtol=1e-9) else f"{format_given(abs(value))}{_KEPT}"
            terms.append(_term(f"{_MINUS if value < 0 else _PLUS}{_KEPT}{size}", base.parameters[k]))
    return Markup('<span class="sum" title="{}">{}</span>').format(label(base.names[row]), Markup(" ").join(terms))


def symbol(parameter: Parameter) -> Markup:
    """Return a standard parameter as markup, such as I with the index zz, link1."""
    found = _INDEXED.fullmatch(parameter.symbol)
    letter, index = (found[1], f"{found[2]},{_KEPT}") if found else (label(parameter.symbol), "")
    return Markup("<var>{}</var><sub>{}<bdi>{}</bdi></sub>").format(letter, index, label(parameter.owner))


def _term(before: str, parameter: Parameter) -> Markup:
    kind = "term" if len(parameter.owner) <= _LONGEST else "term long"
    return Markup('<span class="{}">{}{}</span>').format(kind, escape(before), symbol(parameter))
