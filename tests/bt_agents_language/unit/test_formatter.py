# SPDX-License-Identifier: Apache-2.0
"""The canonical style, case by case; the laws are in the property tests."""

from __future__ import annotations

import textwrap

import pytest

from bt_agents_core.errors import BtAgentsError, ReadError
from bt_agents_language.tools.formatting import formatter
from bt_agents_language.tools.formatting.formatter import format_source
from bt_agents_language.yaml.source import Source


def formatted(text: str) -> str:
    return format_source(Source("a.yaml", textwrap.dedent(text)))


def becomes(text: str, wanted: str) -> None:
    wanted = textwrap.dedent(wanted)
    assert formatted(text) == wanted
    assert formatted(wanted) == wanted


def test_two_spaces_a_level_and_lists_below_their_key():
    becomes(
        """\
        tree:
            sequence:
            - say: Hello.
            -   selector:
                  - wait: 1 s
            - - 1
              -   - 2
        """,
        """\
        tree:
          sequence:
            - say: Hello.
            - selector:
                - wait: 1 s
            - - 1
              - - 2
        """,
    )


def test_short_braces_stay_with_canonical_spaces():
    becomes("a: { b : 1,c: [ x,  y ] , d: {} }\n", "a: {b: 1, c: [x, y], d: {}}\n")


def test_a_single_pair_in_a_list_may_go_without_braces():
    becomes("a: [b,  c:  d , {e:  f}]\n", "a: [b, c: d, {e: f}]\n")


def test_braces_over_several_lines_are_joined_when_they_fit():
    becomes("a: {b: 1,\n    c: some\n      words,\n}\n", "a: {b: 1, c: some words}\n")


def test_braces_that_do_not_fit_the_line_become_a_block():
    text = "x" * 80
    becomes(
        f"a: [{{show: {{text: {text}, duration: '${{d}}'}}, when: x}}, {{b: 2}}]\n",
        f"a:\n  - show:\n      text: {text}\n      duration: ${{d}}\n    when: x\n  - {{b: 2}}\n",
    )


def test_a_line_of_99_columns_fits():
    head = "a: {b: "
    fits = f"{head}{'x' * (99 - len(head) - 1)}}}\n"
    assert formatted(fits) == fits
    assert formatted(fits.replace("x}", "xx}")).startswith("a:\n  b: x")


def test_braces_with_a_comment_inside_become_a_block():
    becomes(
        """\
        a: {
          b: 1,  # one
          # two
          c: 2
          # three
        }  # four
        d: 3
        """,
        """\
        a:
          b: 1  # one
          # two
          c: 2
          # three
        # four
        d: 3
        """,
    )


def test_a_comment_inside_of_empty_braces_goes_beside_them():
    becomes("a: [ # none yet\n  ]\nb: 1\n", "a: []  # none yet\nb: 1\n")


@pytest.mark.parametrize(
    ("written", "wanted"),
    [
        ("'first time'", "first time"),
        ('"first_time"', "first_time"),
        ('"schöne Grüße"', "schöne Grüße"),
        ('"${answer}"', "${answer}"),
        ("'yes'", '"yes"'),
        ("'5 s'", '"5 s"'),
        ("'010'", '"010"'),
        ("''", '""'),
        ("'it''s'", '"it\'s"'),
        ("'say \"hi\"'", "'say \"hi\"'"),
        ('"say \\"hi\\""', '"say \\"hi\\""'),
        ("Where to?", '"Where to?"'),
        ('Did you say "yes"?', "'Did you say \"yes\"?'"),
        ("'a: b'", '"a: b"'),
        ("'Hello there.'", '"Hello there."'),
        ("Hello there.", "Hello there."),
        ('"a\\nb"', '"a\\nb"'),
        ("yes", "yes"),
        ("1e3", "1e3"),
    ],
)
def test_quotes_stay_where_they_matter_and_are_double(written, wanted):
    becomes(f"a: {written}\n", f"a: {wanted}\n")


def test_inside_braces_a_name_in_a_value_keeps_its_quotes():
    becomes("a: {b: '${c}', d: 'two words'}\n", 'a: {b: "${c}", d: two words}\n')


def test_the_texts_of_a_list_are_quoted_alike():
    becomes("a: ['yes', 'no', 'perhaps']\n", 'a: ["yes", "no", "perhaps"]\n')
    becomes("a: ['left', 'right']\n", "a: [left, right]\n")


def test_comments_keep_their_place_and_their_column():
    becomes(
        """\
        # head

        a: 1        # one
        bb: 2# no comment
        c:   # three
            # before d
            d: 4 # four
              # after d
        # before e
        e: 5
          # end
        """,
        """\
        # head

        a: 1  # one
        bb: 2# no comment
        c:  # three
          # before d
          d: 4  # four
          # after d
        # before e
        e: 5
        # end
        """,
    )


def test_a_comment_between_a_key_and_its_value_keeps_the_value_below():
    becomes(
        "a:  # why\n    # and how\n    5 s # five\nb: 1\n",
        "a:  # why\n  # and how\n  5 s  # five\nb: 1\n",
    )


ONE_AND_THREE = "a: 1  # one\nb: 2\nlong: 3  # three\n"


@pytest.mark.parametrize("blanks", [1, 2, 3, 20])
def test_a_comment_stands_two_blanks_behind_its_line(blanks):
    becomes(f"a: 1{' ' * blanks}# one\nb: 2\nlong: 3 # three\n", ONE_AND_THREE)


@pytest.mark.parametrize("column", [7, 9, 30])
def test_comments_of_neighbouring_lines_stay_lined_up_in_the_first_column_that_fits(column):
    lines = [f"{line:{column}}# {line[0]}\n" for line in ("a: 1", "bbb: 2", "c: 3")]
    becomes("".join(lines) + "d: 4 # d\n", "a: 1    # a\nbbb: 2  # b\nc: 3    # c\nd: 4  # d\n")


def test_a_comment_behind_a_dash_goes_above_its_item():
    becomes("- # first\n  a: 1\n-\n  # second\n  b: 2\n", "# first\n- a: 1\n# second\n- b: 2\n")


def test_one_blank_line_stays_and_more_become_one():
    becomes("\n\na: 1\n\n\n\nb:\n\n  c: 2\n\n  d: 3\n\n", "a: 1\n\nb:\n  c: 2\n\n  d: 3\n")


def test_windows_line_ends_tabs_and_spaces_at_the_end_go():
    becomes("a: 1 \t\r\nb:\t2\r\n", "a: 1\nb: 2\n")


def test_document_marks_go():
    becomes("---\na: 1\n...\n", "a: 1\n")


def test_long_texts_keep_their_line_breaks():
    becomes(
        """\
        a: one
            two

            three
        b: >   # folded
            one
              deeper

            two~~
        c: |+
           x

        d:
           "one
           two"
        e: |2
            x
        """.replace("~", " "),
        """\
        a: one
          two

          three
        b: >  # folded
          one
            deeper

          two~~
        c: |+
          x

        d:
          "one
            two"
        e: |2
            x
        """.replace("~", " "),
    )


def test_keys_of_a_node_follow_the_documented_order():
    becomes(
        """\
        tree:
          - no: node
        on_cancel:
          timeout: 5 s
          when: live.person
          name: bye
          subtree: x
          invert: true
          on_failure: {when: y, name: z, say: Sorry}
          retry: 2
          with: {a: 1}
        """,
        """\
        tree:
          - no: node
        on_cancel:
          name: bye
          when: live.person
          timeout: 5 s
          subtree: x
          with: {a: 1}
          retry: 2
          invert: true
          on_failure: {name: z, when: y, say: Sorry}
        """,
    )


def test_keys_stay_where_a_comment_would_change_its_place():
    text = "tree:\n  timeout: 5 s  # quick\n  name: x\n  say: Hello.\n"
    assert formatted(text) == text


def test_other_keys_stay_in_their_order():
    text = "tree: {say: x}\nagent: a\nformat: 1\nprofile: {when: 1, name: 2}\n"
    assert formatted(text) == text


def test_a_file_with_errors_of_form_is_refused_with_all_of_them():
    with pytest.raises(ReadError) as error:
        formatted("a: 1\na: 2\nb: &x 3\n")
    assert [line.partition(": error")[0] for line in error.value.lines] == [
        "a.yaml:2:1",
        "a.yaml:3:4",
    ]


def test_what_would_not_say_the_same_is_left_as_it_is():
    with pytest.raises((BtAgentsError, ReadError)):
        formatted(f"? {'x' * 1500}\n: 1\n")


def test_a_slip_of_the_formatter_itself_changes_no_file(monkeypatch):
    monkeypatch.setattr(formatter, "in_one_line", lambda *_, **__: "2")
    with pytest.raises(BtAgentsError, match=r"a\.yaml: left as it is, because it would not say"):
        formatted("a: 1\n")
