# SPDX-License-Identifier: Apache-2.0
"""Messages about optional packages that are missing."""

_OF_THE_LAB = (
    "install it with pip install 'bt-agents[lab]', or beside a workspace of colcon with "
    "pip install mcap-ros2-support"
)
_OTHERS = {
    "psycopg": "install it with pip install 'bt-agents[fleet]', or beside a workspace of colcon "
    "with pip install 'psycopg[binary]'"
}


def how_to_install(package: str) -> str:
    """Return instructions for installing a package that rosdep does not know."""
    return _OTHERS.get(package, _OF_THE_LAB)


def journal_needs(package: str | None) -> str:
    """Return a message that a journal needs a missing module, and how to get its package."""
    name = (package or "").partition(".")[0]
    return f"a journal needs the package {name}; {how_to_install(name)}"
