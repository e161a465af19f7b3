# SPDX-License-Identifier: Apache-2.0
"""Type support of messages without the generator of their code.

rosidl_generator_py 0.22 imports its generator, with the parser and the template engine that it
needs, into each process that uses a message: 4.5 MiB, which no process needs. It allows for
installations without the generator. No upstream issue is known; remove this module when ``import
rosidl_generator_py`` does not import ``lark``.
"""

from __future__ import annotations

import sys
from importlib import import_module

_PACKAGE = "rosidl_generator_py"
_GENERATOR = f"{_PACKAGE}.generate_py_impl"


def import_type_support() -> None:
    """Import what messages need of the package; the generator stays importable by its module."""
    if _PACKAGE in sys.modules:
        return
    sys.modules[_GENERATOR] = None  # type: ignore[assignment]
    try:
        import_module(_PACKAGE)
    finally:
        del sys.modules[_GENERATOR]
