# SPDX-License-Identifier: Apache-2.0
"""The files for DDS security and for TLS, as the command line writes them."""

from __future__ import annotations

import itertools
import re
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest
from click.testing import CliRunner

from bt_agents_language.files.folder_reader import read_trees
from bt_agents_ros.installed import InstalledInterfaces
from bt_agents_tools.cli.commands.security import security
from bt_agents_tools.security.access_table import ROLES, Access, access_table
from bt_agents_tools.security.dds_policies import (
    dds_topics,
    governance_xml,
    permissions_xml,
    policy_xml,
)
from checkout import ROOT

CALLED = re.compile(r'\.ask\(\s*f?"([^"]+)"')
READ_ONLY = {
    *("rq/marketplace/describe_parametersRequest", "rq/marketplace/get_parametersRequest"),
    *("rq/agents/get_parametersRequest", "rq/agents/versionsRequest"),
    *("rt/parameter_events", "rt/rosout", "ros_discovery_info"),
    "rr/_bt_agents_observer/get_type_descriptionReply",
}


@pytest.fixture(scope="module")
def table() -> tuple[Access, ...]:
    return access_table(read_trees(ROOT / "trees", InstalledInterfaces()), ("agents", "more"))


def role(table: tuple[Access, ...], name: str) -> tuple[set[str], set[str]]:
    return dds_topics(next(access for access in table if access.name == name))


def test_each_role_may_do_what_those_before_it_may(table: tuple[Access, ...]) -> None:
    for less, more in itertools.pairwise(ROLES):
        for before, after in zip(role(table, less), role(table, more), strict=True):
            assert before <= after
        assert role(table, less)[0] < role(table, more)[0]


def test_whoever_watches_changes_nothing(table: tuple[Access, ...]) -> None:
    written = {one for one in role(table, "watch")[0] if "/more/" not in one}
    assert written == READ_ONLY


def test_only_authors_and_the_studio_manage_profiles_and_only_hosts_bid(
    table: tuple[Access, ...],
) -> None:
    def writers(topic: str) -> set[str]:
        return {access.name for access in table if topic in dds_topics(access)[0]}

    assert writers("rq/feedback/manageRequest") == {"author", "studio"}
    assert writers("rq/agents/set_profileRequest") == {"feedback"}
    assert writers("rq/agents/run/_action/send_goalRequest") == {"marketplace"}
    assert writers("rt/bt_agents/bids") == {"agents", "more"}
    assert writers("rt/agents/heartbeat") == {"agents"}
    assert writers("rq/marketplace/cancelRequest") == {"feedback", "operate", "author", "studio"}
    assert writers("rt/marketplace/heartbeat") == {"marketplace"}


def test_an_author_may_call_every_service_that_a_command_calls(table: tuple[Access, ...]) -> None:
    sources = (ROOT / "bt_agents_tools" / "bt_agents_tools").rglob("*.py")
    called = {name for path in sources for name in CALLED.findall(path.read_text())}
    assert len(called) > 8
    author = next(access for access in table if access.name == "author")
    unknown = {re.sub(r"\{[^}]*\}", "agents", name) for name in called} - set(author.calls)
    assert unknown == set()


def test_a_policy_has_the_form_that_ros2_security_reads(table: tuple[Access, ...]) -> None:
    root = Xml.fromstring(policy_xml(table, "/robot1"))
    assert (root.tag, root.get("version")) == ("policy", "0.2.0")
    enclaves = root.findall("enclaves/enclave")
    assert [one.get("path") for one in enclaves] == [f"/bt_agents/{one.name}" for one in table]
    entries = {"topics": "topic", "services": "service", "actions": "action"}
    rights = {"topics": {"publish", "subscribe"}, "services": {"reply", "request"}}
    rights["actions"] = {"execute", "call"}
    for enclave in enclaves:
        [profile] = enclave.findall("profiles/profile")
        assert profile.get("ns") == "/robot1"
        assert profile.get("node")
        for group in profile:
            assert set(group.attrib) < rights[group.tag]
            assert set(group.attrib.values()) == {"ALLOW"}
            assert {one.tag for one in group} == {entries[group.tag]}
            assert all((one.text or "").startswith("/") for one in group)


def test_permissions_name_the_enclave_and_deny_the_rest(table: tuple[Access, ...]) -> None:
    for access in table:
        root = Xml.fromstring(permissions_xml(access, 7))
        [grant] = root.findall("permissions/grant")
        assert [one.tag for one in grant] == ["subject_name", "validity", "allow_rule", "default"]
        assert grant.findtext("subject_name") == f"CN=/bt_agents/{access.name}"
        assert grant.findtext("default") == "DENY"
        assert [one.tag for one in grant.iterfind("allow_rule/*")] == [
            "domains",
            "publish",
            "subscribe",
        ]
        assert grant.findtext("allow_rule/domains/id") == "7"
        topics = [one.text or "" for one in grant.iter("topic")]
        named = [one for one in topics if not one.endswith("_streams/*")]
        assert all("*" not in one and "~" not in one and "{" not in one for one in named)


def test_the_governance_lets_nobody_unknown_in() -> None:
    rule = Xml.fromstring(governance_xml(7)).find("domain_access_rules/domain_rule")
    assert rule is not None
    assert rule.findtext("allow_unauthenticated_participants") == "false"
    assert rule.findtext("enable_join_access_control") == "true"
    assert rule.findtext("topic_access_rules/topic_rule/enable_write_access_control") == "true"


def test_the_command_writes_a_file_for_each_enclave(tmp_path: Path) -> None:
    run = CliRunner().invoke(
        security, ["policies", str(ROOT / "trees"), "-o", str(tmp_path), "--domain", "7"]
    )
    assert run.exit_code == 0, run.output
    assert {path.stem for path in (tmp_path / "permissions").iterdir()} >= {"agents", *ROLES}
    assert "<id>7</id>" in (tmp_path / "governance.xml").read_text()
    assert (tmp_path / "policy.xml").is_file()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--peer", "10.0.0.7"], "expected an address and a port"),
        (["--listen", "10.0.0.7:99999"], "expected an address and a port"),
        ([], "--listen, --peer or both"),
    ],
)
def test_tls_without_a_place_is_refused(tmp_path: Path, options: list[str], words: str) -> None:
    files = ["--ca", "a.pem", "--cert", "b.pem", "--key", "c.key"]
    run = CliRunner().invoke(security, ["tls", *files, *options, "-o", str(tmp_path / "x.xml")])
    assert run.exit_code == 2
    assert words in run.output


def test_tls_without_its_files_is_refused_as_fast_dds_would_go_on_without(tmp_path: Path) -> None:
    files = ["--ca", "a.pem", "--cert", "b.pem", "--key", "c.key", "--listen", "10.0.0.7:5100"]
    run = CliRunner().invoke(security, ["tls", *files, "-o", str(tmp_path / "x.xml")])
    assert "NO_FILE" in str(run.exception)
    assert not (tmp_path / "x.xml").exists()
