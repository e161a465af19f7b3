# SPDX-License-Identifier: Apache-2.0
"""Profiles of Fast DDS derived from others: they keep the settings of the originals."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

from bt_agents_core.errors import BtAgentsError
from bt_agents_ros.fastdds_profile import NAMESPACE, FastDdsProfile

SPACES = (f' xmlns="{NAMESPACE}"', "")


def profile(folder: Path, text: str) -> FastDdsProfile:
    file = folder / "profile.xml"
    file.write_text(text)
    return FastDdsProfile(str(file))


def tags(made: FastDdsProfile, of: str) -> list[str]:
    """Return the texts of all elements with a name, in any namespace."""
    found = ElementTree.fromstring(made.text()).iter()
    return [one.text or "" for one in found if one.tag.rpartition("}")[2] == of]


@pytest.mark.parametrize("space", SPACES, ids=["namespace", "none"])
@pytest.mark.parametrize("root", ["dds", "profiles"])
def test_property_is_added_to_default_participants_only(tmp_path, space, root):
    participant = (
        '<participant profile_name="{}" is_default_profile="{}"><rtps><propertiesPolicy>'
        "<properties><property><name>a</name><value>b</value></property></properties>"
        "</propertiesPolicy></rtps></participant>"
    )
    both = participant.format("mine", "true") + participant.format("other", "false")
    inside = f"<profiles>{both}</profiles>" if root == "dds" else both
    made = profile(tmp_path, f"<{root}{space}>{inside}</{root}>")
    made.set_property("c", "d")
    assert tags(made, "name") == ["a", "c", "a"]
    assert tags(made, "value") == ["b", "d", "b"]
    assert len(tags(made, "participant")) == len(tags(made, "properties")) == 2
    spaces = {one.tag.partition("}")[0] for one in ElementTree.fromstring(made.text()).iter()}
    assert len(spaces) == 1 or not space


def test_missing_file_yields_default_participant_with_property():
    made = FastDdsProfile("")
    made.set_property("c", "d")
    assert 'is_default_profile="true"' in made.text()
    assert tags(made, "name") == ["c"]


def test_only_lifespans_are_extended(tmp_path):
    spans = ("<sec>1</sec>", "<nanosec>300000000</nanosec>", "<sec>DURATION_INFINITY</sec>")
    writers = "".join(
        f"<data_writer><qos><lifespan><duration>{span}</duration></lifespan></qos></data_writer>"
        for span in spans
    )
    lease = "<leaseDuration><sec>10</sec></leaseDuration>"
    made = profile(
        tmp_path, f'<dds xmlns="{NAMESPACE}"><profiles>{lease}{writers}</profiles></dds>'
    )
    made.prolong_lifespans(2.5)
    assert tags(made, "sec") == ["10", "2", "0", "DURATION_INFINITY"]
    assert tags(made, "nanosec") == ["500000000", "750000000"]


def test_invalid_xml_file_is_named(tmp_path):
    with pytest.raises(BtAgentsError, match=r"profile\.xml', which cannot be read: no element"):
        profile(tmp_path, "<dds>")
