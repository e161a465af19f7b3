# SPDX-License-Identifier: Apache-2.0
"""Test results as JUnit XML, which every build server shows."""

from __future__ import annotations

import re
from collections.abc import Iterable
from xml.etree import ElementTree

from bt_agents_tools.rehearsal.suite import FileResult, failure

_NOT_IN_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit(results: Iterable[FileResult]) -> str:
    """Return results as a JUnit document: a suite a file, a test case a case."""
    root = ElementTree.Element("testsuites", name="bt-agents")
    for result in results:
        failed = sum(not case.passed for case in result.cases)
        suite = ElementTree.SubElement(
            root,
            "testsuite",
            name=str(result.file),
            tests=str(len(result.cases) + (result.error is not None)),
            failures=str(failed),
            errors=str(int(result.error is not None)),
            time=f"{sum(case.elapsed_s for case in result.cases):.3f}",
        )
        if result.error is not None:
            case = ElementTree.SubElement(
                suite, "testcase", name="the file can be read", classname=str(result.file)
            )
            broken = ElementTree.SubElement(case, "error", message=_clean(result.error.lines[0]))
            broken.text = _clean(result.error.report)
        for one in result.cases:
            position = one.case.position
            case = ElementTree.SubElement(
                suite,
                "testcase",
                name=_clean(one.case.name),
                classname=result.agent.name if result.agent is not None else "",
                file=position.file,
                line=str(position.line),
                time=f"{one.elapsed_s:.3f}",
            )
            if one.failures:
                first = one.failures[0].message
                failed_case = ElementTree.SubElement(case, "failure", message=_clean(first))
                failed_case.text = _clean(failure(one))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _clean(text: str) -> str:
    return _NOT_IN_XML.sub("�", text)
