# SPDX-License-Identifier: Apache-2.0
"""The policy for DDS security, as written by the command line."""

from __future__ import annotations

import itertools
import re
import shutil
from pathlib import Path
from xml.etree import ElementTree as Xml

import pytest
from click.testing import CliRunner

from bt_agents_core.errors import BtAgentsError
from bt_agents_language.files.folder_reader import Trees, read_trees
from bt_agents_ros.installed import InstalledInterfaces
from bt_agents_tools.cli.commands.security import security
from bt_agents_tools.security_policy import ROLES, Rights, policy_xml, rights_of
from checkout import ROOT

CALLED = re.compile(r'\.ask\(\s*f?"([^"]+)"')
HOSTS = ("agents", "more")


@pytest.fixture(scope="module")
def trees() -> Trees:
    return read_trees(ROOT / "trees", InstalledInterfaces())


@pytest.fixture(scope="module")
def table(trees: Trees) -> dict[str, Rights]:
    return rights_of(trees, HOSTS)


def test_each_role_includes_rights_of_lower_roles(table: dict[str, Rights]) -> None:
    for less, more in itertools.pairwise(ROLES):
        assert all(table[less][right] <= table[more][right] for right in table[less])
        assert table[less] != table[more]


def test_watch_role_changes_nothing(table: dict[str, Rights]) -> None:
    watch = table["watch"]
    assert watch["publish"] == {"/parameter_events", "/rosout"}
    assert watch["reply"] == {"_bt_agents_observer/get_type_description"}
    assert not watch["execute"] | watch["call"]
    assert watch["request"] == {
        *("marketplace/describe_parameters", "marketplace/get_parameters"),
        *(f"{host}/get_parameters" for host in HOSTS),
    }


@pytest.mark.parametrize(
    ("right", "name", "who"),
    [
        ("request", "feedback/manage", {"author", "studio"}),
        ("request", "agents/set_profile", {"feedback"}),
        ("publish", "bt_agents/bids", {"agents", "more"}),
        ("request", "marketplace/cancel", {"feedback", "operate", "author", "studio"}),
        ("request", "marketplace/set_parameters_atomically", {"operate", "author", "studio"}),
        ("subscribe", "more/heartbeat", {"marketplace", "robot", "studio", *ROLES}),
    ],
)
def test_only_listed_roles_have_right(
    table: dict[str, Rights], right: str, name: str, who: set[str]
) -> None:
    assert {one for one, rights in table.items() if name in rights[right]} == who


def test_author_role_may_call_service_of_every_command(table: dict[str, Rights]) -> None:
    sources = (ROOT / "bt_agents_tools" / "bt_agents_tools").rglob("*.py")
    called = {name for path in sources for name in CALLED.findall(path.read_text())}
    assert len(called) > 8
    named = {re.sub(r"\{[^}]*\}", "agents", name) for name in called}
    assert named - table["author"]["request"] == set()


def test_policy_has_sros2_format(trees: Trees, table: dict[str, Rights]) -> None:
    root = Xml.fromstring(policy_xml(trees, HOSTS, "/robot1"))
    assert (root.tag, root.get("version")) == ("policy", "0.2.0")
    enclaves = root.findall("enclaves/enclave")
    assert [one.get("path") for one in enclaves] == [f"/bt_agents/{name}" for name in table]
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
            for one in group:
                name = (one.text or "").removesuffix("_streams/*")
                assert name.startswith("/")
                assert not set(name) & set("*~{")


@pytest.mark.parametrize("namespace", ["robot1", "/robot1/", "/robot1"])
def test_slashes_of_namespace_do_not_count(trees: Trees, namespace: str) -> None:
    assert policy_xml(trees, HOSTS, namespace) == policy_xml(trees, HOSTS, "/robot1")


@pytest.mark.parametrize("host", ["marketplace", "operate", "a/b", "a b", ""])
def test_unusable_name_of_host_is_refused(trees: Trees, host: str) -> None:
    with pytest.raises(BtAgentsError):
        policy_xml(trees, (host,))


def test_the_command_names_what_is_missing(tmp_path: Path) -> None:
    folder = shutil.copytree(ROOT / "trees", tmp_path / "trees")
    (folder / "agents" / "broken.yaml").write_text("agent: [")
    run = CliRunner().invoke(security, [str(folder), "-o", str(tmp_path / "policy.xml")])
    assert run.exit_code == 0
    assert "broken.yaml:1" in run.output


def test_the_command_writes_the_policy(tmp_path: Path) -> None:
    file = tmp_path / "policy.xml"
    run = CliRunner().invoke(security, [str(ROOT / "trees"), "-o", str(file)])
    assert run.exit_code == 0, run.output
    assert 'path="/bt_agents/author"' in file.read_text()
