# SPDX-License-Identifier: Apache-2.0
"""Codes for files of Groot2 and BehaviorTree.CPP, which are imported and never run as they are."""

from __future__ import annotations

from bt_agents_language.reference.codes.entry import Code, FileKind, error

_RIGHT = """
    <root BTCPP_format="4">
      <BehaviorTree ID="main"><Sleep msec="500"/></BehaviorTree>
    </root>
    """


def _error(code: str, meaning: str, wrong: str, right: str = _RIGHT) -> Code:
    return error(code, meaning, wrong, right, FileKind.XML)


XML_CODES = (
    _error(
        "xml-syntax",
        "The file is not valid XML.",
        """
        <root BTCPP_format="4">
          <BehaviorTree ID="main"><Sleep msec="500"></BehaviorTree>
        </root>
        """,
    ),
    _error(
        "xml-doctype",
        "The file declares a document type, which could pull in other files.",
        """
        <!DOCTYPE root SYSTEM "root.dtd">
        <root BTCPP_format="4">
          <BehaviorTree ID="main"><Sleep msec="500"/></BehaviorTree>
        </root>
        """,
    ),
    _error(
        "xml-root",
        "The outermost element is not a root with trees in it.",
        """
        <BehaviorTree ID="main"><Sleep msec="500"/></BehaviorTree>
        """,
    ),
    _error(
        "missing-attribute",
        "An element lacks an attribute that is needed.",
        """
        <root BTCPP_format="4">
          <BehaviorTree ID="main"><Sleep/></BehaviorTree>
        </root>
        """,
    ),
    _error(
        "unknown-attribute",
        "An element has an attribute that its kind does not have.",
        """
        <root BTCPP_format="4">
          <BehaviorTree ID="main"><Sleep msec="500" seconds="1"/></BehaviorTree>
        </root>
        """,
    ),
    _error(
        "bad-attribute",
        "The value of an attribute is not of the expected kind.",
        """
        <root BTCPP_format="4">
          <BehaviorTree ID="main"><Sleep msec="soon"/></BehaviorTree>
        </root>
        """,
    ),
    _error(
        "wrong-children",
        "An element has more or fewer children than its kind has.",
        """
        <root BTCPP_format="4">
          <BehaviorTree ID="main"><Sleep msec="500"/><Sleep msec="500"/></BehaviorTree>
        </root>
        """,
        """
        <root BTCPP_format="4">
          <BehaviorTree ID="main">
            <Sequence><Sleep msec="500"/><Sleep msec="500"/></Sequence>
          </BehaviorTree>
        </root>
        """,
    ),
    _error(
        "bad-script",
        "A script is not written as scripts of BehaviorTree.CPP are.",
        """
        <root BTCPP_format="4">
          <BehaviorTree ID="main"><Script code="tries :="/></BehaviorTree>
        </root>
        """,
        """
        <root BTCPP_format="4">
          <BehaviorTree ID="main"><Script code="tries := 1"/></BehaviorTree>
        </root>
        """,
    ),
)
"""In the order in which a file is read."""
