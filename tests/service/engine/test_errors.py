"""Names of errors, as every transport shows them."""

from __future__ import annotations

import inspect

from service.engine import errors

BASE = errors.ShapeConceptsError
EVERY = [e for _, e in inspect.getmembers(errors, inspect.isclass) if issubclass(e, BASE) and e is not BASE]


def test_names_are_kebab_case_and_told_apart():
    assert errors.TooFewPoints.type_name() == "too-few-points"
    names = [error.type_name() for error in EVERY]
    assert len(set(names)) == len(names)
    assert all(name == name.lower() and not name.startswith("-") for name in names)


def test_every_error_says_when_it_is_raised():
    assert all("__doc__" in vars(error) and vars(error)["__doc__"] for error in EVERY)
