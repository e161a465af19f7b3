# SPDX-License-Identifier: Apache-2.0
"""DDS security files of an access table: policy of SROS2, governance and permissions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from xml.etree import ElementTree as Xml

from bt_agents_tools.security.access_table import ROLES, Access
from bt_agents_tools.security.xml_document import xml_text

ENCLAVES = "/bt_agents"
"""Path below which each node and each role has an enclave of its name."""

OBSERVER = "_bt_agents_observer"
"""Name of the node of every command of the command line."""

_ALL_PARTICIPANTS = "ros_discovery_info"
_ACTION_SERVICES = ("send_goal", "get_result", "cancel_goal")
_ACTION_TOPICS = ("feedback", "status")
_VALID = ("2024-01-01T00:00:00", "2044-01-01T00:00:00")

_PROTECTED = (
    ("allow_unauthenticated_participants", "false"),
    ("enable_join_access_control", "true"),
    ("discovery_protection_kind", "ENCRYPT"),
    ("liveliness_protection_kind", "ENCRYPT"),
    ("rtps_protection_kind", "SIGN"),
)
_TOPIC_RULE = (
    ("topic_expression", "*"),
    ("enable_discovery_protection", "true"),
    ("enable_liveliness_protection", "true"),
    ("enable_read_access_control", "true"),
    ("enable_write_access_control", "true"),
    ("metadata_protection_kind", "ENCRYPT"),
    ("data_protection_kind", "ENCRYPT"),
)
_SCHEMAS = "http://www.omg.org/spec/DDS-SECURITY/20170901"


def node_name(access: Access) -> str:
    """Return the name of the node that has these rights."""
    return OBSERVER if access.name in ROLES else access.name


def full_name(name: str, node: str, namespace: str = "/") -> str:
    """Return the fully qualified name of what a node calls by a relative or private name."""
    if name.startswith("/"):
        return name
    name = name.replace("~", node, 1) if name.startswith("~") else name
    return f"{namespace.rstrip('/')}/{name}"


def policy_xml(table: Sequence[Access], namespace: str = "/") -> str:
    """Return the table as a policy file, of which ``ros2 security`` makes a keystore."""
    root = Xml.Element("policy", version="0.2.0")
    enclaves = Xml.SubElement(root, "enclaves")
    for access in table:
        enclave = Xml.SubElement(enclaves, "enclave", path=f"{ENCLAVES}/{access.name}")
        profiles = Xml.SubElement(enclave, "profiles")
        node = node_name(access)
        profile = Xml.SubElement(profiles, "profile", ns=namespace, node=node)
        for kind, right, entry, names in (
            ("topics", "publish", "topic", access.publishes),
            ("topics", "subscribe", "topic", access.subscribes),
            ("services", "reply", "service", access.serves),
            ("services", "request", "service", access.calls),
            ("actions", "execute", "action", access.executes),
            ("actions", "call", "action", access.sends_goals),
        ):
            if names:
                group = Xml.SubElement(profile, kind, {right: "ALLOW"})
                for name in names:
                    Xml.SubElement(group, entry).text = full_name(name, node, namespace)
    return xml_text(root)


def permissions_xml(access: Access, domain: int, namespace: str = "/") -> str:
    """Return the permissions of one enclave, to be signed; what is not named is denied."""
    root = _document("omg_shared_ca_permissions.xsd")
    enclave = f"{ENCLAVES}/{access.name}"
    grant = Xml.SubElement(Xml.SubElement(root, "permissions"), "grant", name=enclave)
    Xml.SubElement(grant, "subject_name").text = f"CN={enclave}"
    validity = Xml.SubElement(grant, "validity")
    for name, moment in zip(("not_before", "not_after"), _VALID, strict=True):
        Xml.SubElement(validity, name).text = moment
    rule = Xml.SubElement(grant, "allow_rule")
    Xml.SubElement(Xml.SubElement(rule, "domains"), "id").text = str(domain)
    written, read = dds_topics(access, namespace)
    for name, topics in (("publish", written), ("subscribe", read)):
        listed = Xml.SubElement(Xml.SubElement(rule, name), "topics")
        for topic in sorted(topics):
            Xml.SubElement(listed, "topic").text = topic
    Xml.SubElement(grant, "default").text = "DENY"
    return xml_text(root)


def governance_xml(domain: int) -> str:
    """Return the governance of the domain, to be signed: nobody unknown, nothing in the clear."""
    root = _document("omg_shared_ca_governance.xsd")
    rule = Xml.SubElement(Xml.SubElement(root, "domain_access_rules"), "domain_rule")
    Xml.SubElement(Xml.SubElement(rule, "domains"), "id").text = str(domain)
    for name, value in _PROTECTED:
        Xml.SubElement(rule, name).text = value
    topic = Xml.SubElement(Xml.SubElement(rule, "topic_access_rules"), "topic_rule")
    for name, value in _TOPIC_RULE:
        Xml.SubElement(topic, name).text = value
    return xml_text(root)


def dds_topics(access: Access, namespace: str = "/") -> tuple[set[str], set[str]]:
    """Return the DDS topics that the rights write, and those that they read."""
    node = node_name(access)

    def full(names: Iterable[str]) -> list[str]:
        return [full_name(name, node, namespace) for name in names]

    served, called = full(access.serves), full(access.calls)
    written = {f"rt{name}" for name in full(access.publishes)}
    read = {f"rt{name}" for name in full(access.subscribes)}
    for names, services, topics in (
        (full(access.executes), served, written),
        (full(access.sends_goals), called, read),
    ):
        for name in names:
            services += [f"{name}/_action/{one}" for one in _ACTION_SERVICES]
            topics |= {f"rt{name}/_action/{one}" for one in _ACTION_TOPICS}
    written |= {f"rr{name}Reply" for name in served} | {f"rq{name}Request" for name in called}
    read |= {f"rq{name}Request" for name in served} | {f"rr{name}Reply" for name in called}
    return written | {_ALL_PARTICIPANTS}, read | {_ALL_PARTICIPANTS}


def _document(schema: str) -> Xml.Element:
    return Xml.Element(
        "dds",
        {
            "xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance",
            "xsi:noNamespaceSchemaLocation": f"{_SCHEMAS}/{schema}",
        },
    )
