# SPDX-License-Identifier: Apache-2.0
"""Public methods have docstrings, or override or implement a documented one."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Iterator
from typing import Protocol

from product_modules import product_modules


def public_classes() -> list[type]:
    names = [name for name in product_modules() if not name.endswith("__main__")]
    return [
        value
        for name in names
        for value in vars(importlib.import_module(name)).values()
        if inspect.isclass(value) and value.__module__ == name
        if not value.__name__.startswith("_")
    ]


def members(protocol: type) -> set[str]:
    return {
        name
        for part in protocol.__mro__
        if getattr(part, "_is_protocol", False) and part is not Protocol
        for name in (*vars(part), *inspect.get_annotations(part))
        if not name.startswith("_")
    }


def described(owner: type, protocols: list[type]) -> set[str]:
    """Return the names in the bases of a class, or in a protocol that it implements."""
    inherited = {name for base in owner.__mro__[1:] for name in vars(base)}
    fulfilled = (
        members(protocol)
        for protocol in protocols
        if protocol is not owner and all(hasattr(owner, name) for name in members(protocol))
    )
    return inherited.union(*fulfilled)


def definition(member: object) -> object:
    """Return the function behind a property or a class method."""
    for attribute in ("fget", "func", "__func__"):
        member = getattr(member, attribute, None) or member
    return member


def undocumented(owner: type, protocols: list[type]) -> Iterator[str]:
    missing = [
        name
        for name, member in vars(owner).items()
        if not name.startswith("_")
        if inspect.isfunction(function := definition(member)) and not function.__doc__
        if function.__qualname__ == f"{owner.__qualname__}.{name}"
    ]
    if missing:
        known = described(owner, protocols)
        yield from (f"{owner.__qualname__}.{name}" for name in missing if name not in known)


class Shown(Protocol):
    def show(self) -> None: ...


class Told:
    def show(self) -> None: ...

    def hide(self) -> None: ...


def test_only_methods_outside_protocols_need_their_own_docstring():
    assert list(undocumented(Told, [Shown])) == ["Told.hide"]
    assert list(undocumented(Told, [])) == ["Told.show", "Told.hide"]


def test_every_public_method_is_documented_at_its_declaration():
    classes = public_classes()
    protocols = [one for one in classes if getattr(one, "_is_protocol", False) and members(one)]
    assert [problem for owner in classes for problem in undocumented(owner, protocols)] == []
