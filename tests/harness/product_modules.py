# SPDX-License-Identifier: Apache-2.0
"""Modules of the product, by name."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from programs import ROOT

PACKAGES = sorted(path.parent for path in ROOT.glob("*/setup.py"))


def product_modules() -> Mapping[str, Path]:
    found: dict[str, Path] = {}
    for package in PACKAGES:
        for path in (package / package.name).rglob("*.py"):
            name = ".".join(path.relative_to(package).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found
