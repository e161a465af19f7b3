# SPDX-License-Identifier: Apache-2.0
"""The current scene in the terminal: values, their certainty, and persons."""

from __future__ import annotations

import json
import math
from io import StringIO
from typing import Any

from rcl_interfaces.msg import ParameterValue
from rich.console import Console

from bt_agents_core.person_facts import message_fields
from bt_agents_core.scene import Origin, SceneParameter
from bt_agents_interfaces.msg import PersonFact, Persons, Scene, SceneValue
from bt_agents_tools.cli.commands.scene import as_document, page

LABELS = {
    "age": SceneParameter(
        name="age", minimum=1.0, maximum=5.0, default=3.0, labels={1.0: "a child", 4.0: "old"}
    )
}


def value(name: str, number: float, origin: Origin, **more: Any) -> SceneValue:
    return SceneValue(name=name, value=number, origin=int(origin), **more)


def scene(*values: SceneValue, **more: Any) -> Scene:
    return Scene(values=values, **({"scene_id": "s", "person": True} | more))


MISSING = value("hurry", math.nan, Origin.MISSING, age_s=math.nan, std=math.nan, confidence=0.0)
KNOWN = scene(
    value("age", 4.2, Origin.MEASURED, age_s=0.21, std=0.35, confidence=0.9, source="faces"),
    value("mood", 3.0, Origin.ESTIMATED, age_s=300.0, std=1.0, source="anna, seen 12 times"),
    value("noise", 2.0, Origin.GIVEN, source="given"),
    MISSING,
    label="Mrs Smith",
    person_id="anna",
    place="lobby",
)


def crowd(addressee: str, reason: str, *names: str) -> Persons:
    scenes = [scene(value("age", 4.0, Origin.MEASURED), MISSING, person_id=n) for n in names]
    return Persons(rule="nearest", addressee=addressee, reason=reason, scenes=scenes)


def shown(message: Any, persons: Any = None) -> list[str]:
    out = StringIO()
    Console(file=out, width=100).print(page(message, persons, LABELS))
    return [" ".join(line.split()) for line in out.getvalue().splitlines()]


def test_value_is_shown_with_label_origin_and_certainty() -> None:
    head, headings, *rows = shown(KNOWN)
    assert head.startswith("Mrs Smith, anna is there, in lobby (")
    assert headings == "parameter value is age sure from"
    assert rows == [
        "age 4.2 ± 0.35 (old) measured 0.2 s 90% faces",
        "mood 3 ± 1 estimated 5 min 100% anna, seen 12 times",
        "noise 2 given 100% given",
        "hurry – missing",
    ]


def test_presence_is_stated_in_words() -> None:
    assert shown(scene(person=False))[0].startswith("nobody is there (")
    assert shown(scene())[0].startswith("somebody is there (")
    lost = scene(person=False, person_id="anna")
    assert shown(lost)[0].startswith("anna is not there any more (")


def test_visit_and_remembered_values_are_shown() -> None:
    fields = message_fields("favourite", "tea")
    fact = PersonFact(key="favourite", value=ParameterValue(**fields["value"]))
    told = value("mood", 2.0, Origin.TOLD, source="the person")
    message = scene(told, person_id="anna", visits=3, remembered=[fact])
    head, _, row, remembered = shown(message)
    assert head.startswith("anna is there, visit 3 (")
    assert row == "mood 2 told 100% the person"
    assert remembered == "remembered: favourite tea"
    assert as_document(message, None)["scene"]["remembered"] == {"favourite": "tea"}


def test_the_addressee_is_marked_with_the_reason() -> None:
    assert shown(scene(), crowd("ben", "ben is nearest: 0.8 m", "anna", "ben"))[1:] == [
        "persons: 2, addressed is ben (rule: nearest; ben is nearest: 0.8 m)",
        "person age hurry",
        "anna 4 –",
        "* ben 4 –",
    ]
    assert shown(scene(), crowd("", "nobody is there"))[1:] == ["persons: none"]
    assert shown(scene(), crowd("", "ben is gone", "anna"))[1] == (
        "persons: 1, nobody is addressed: ben is gone"
    )


def test_markup_in_id_is_shown_literally() -> None:
    assert shown(scene(person_id="[red]x[/]"))[0].startswith("[red]x[/] is there")


def test_the_document_is_json_without_nan() -> None:
    text = json.dumps(as_document(KNOWN, crowd("anna", "", "anna")), allow_nan=False)
    document = json.loads(text)
    assert document["scene"]["values"]["age"]["origin"] == "measured"
    assert document["scene"]["values"]["hurry"]["value"] is None
    assert document["persons"]["addressee"] == "anna"
    assert as_document(KNOWN, None)["persons"] is None
