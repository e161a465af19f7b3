# SPDX-License-Identifier: Apache-2.0
"""Dotted paths into plain data."""

from __future__ import annotations

import pytest

from bt_agents_core.field_path import NoSuchField, NoSuchItem, item_of, value_at

DATA = {"faces": [{"mood": 3.0}, {"mood": 4.0}], "names": ("a", "b"), "text": "abc"}


@pytest.mark.parametrize(
    ("path", "value"),
    [("faces.1.mood", 4.0), ("names.0", "a"), ("faces.0", {"mood": 3.0}), ("text", "abc")],
)
def test_path_follows_field_names_and_item_indices(path, value):
    assert value_at(DATA, path, item_of) == value


@pytest.mark.parametrize(
    ("path", "error", "part", "found"),
    [
        ("face", NoSuchField, "face", ""),
        ("faces.mood", NoSuchField, "mood", "faces"),
        ("faces.0.age", NoSuchField, "age", "faces.0"),
        ("faces.2.mood", NoSuchItem, "2", "faces"),
        ("faces.\u0660", NoSuchField, "\u0660", "faces"),
        ("names.-1", NoSuchField, "-1", "names"),
        ("text.0", NoSuchField, "0", "text"),
        ("faces.0.mood.x", NoSuchField, "x", "faces.0.mood"),
        ("", NoSuchField, "", ""),
    ],
)
def test_invalid_path_reports_how_far_it_resolved(path, error, part, found):
    with pytest.raises(NoSuchField) as caught:
        value_at(DATA, path, item_of)
    assert type(caught.value) is error
    assert (caught.value.part, caught.value.found) == (part, found)
