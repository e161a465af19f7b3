# SPDX-License-Identifier: Apache-2.0
"""ROS types with the names and fields of other packages, compiled once per checkout."""

from __future__ import annotations

import ctypes
import fcntl
import hashlib
import sys
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from checkout import ROOT
from locked_packages import build_wheel

PACKAGE = "py_trees_ros_interfaces"
DEFINITIONS = ROOT / "tests/interfaces"
SOURCE = DEFINITIONS / PACKAGE

_LIBRARIES = (
    "rosidl_generator_c",
    "rosidl_typesupport_fastrtps_c",
    "rosidl_typesupport_introspection_c",
    "rosidl_typesupport_c",
    "rosidl_generator_py",
)
_BUILD_LIMIT_S = 900.0
_loaded: dict[str, ModuleType] = {}


@contextmanager
def compiled_types() -> Iterator[Path]:
    """Make the package importable for a while; skip the tests if it cannot be built.

    Gives the installation prefix, which ROS finds by ``AMENT_PREFIX_PATH``.
    """
    prefix = _built()
    for name in _LIBRARIES:
        ctypes.CDLL(str(prefix / f"lib/lib{PACKAGE}__{name}.so"), ctypes.RTLD_GLOBAL)
    [modules] = prefix.glob("lib/python*/site-packages")
    sys.path.append(str(modules))
    # Extension modules cannot be loaded twice.
    sys.modules.update(_loaded)
    try:
        yield prefix
    finally:
        sys.path.remove(str(modules))
        names = [name for name in sys.modules if name.partition(".")[0] == PACKAGE]
        _loaded.update({name: sys.modules.pop(name) for name in names})


def _built() -> Path:
    digest = hashlib.sha256()
    for path in sorted(DEFINITIONS.rglob("*.*")):
        digest.update(path.relative_to(DEFINITIONS).as_posix().encode() + path.read_bytes())
    folder = ROOT / ".venv" / PACKAGE
    prefix = folder / digest.hexdigest()[:12] / "prefix"
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not prefix.exists():
            _build(prefix.parent)
    return prefix


def _build(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    wheel = build_wheel(SOURCE, folder, _BUILD_LIMIT_S)
    unpacked = folder / "unpacked"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(unpacked)
    [data] = unpacked.glob("*.data/data")
    data.rename(folder / "prefix")
