# SPDX-License-Identifier: Apache-2.0
"""The table of codes: the examples of each code cause it."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from bt_agents_core.diagnostic import Diagnostic, Severity
from bt_agents_core.errors import ReadError
from bt_agents_core.field_types import BindingKind
from bt_agents_groot.document import read_document
from bt_agents_language.diagnostics.collection import Diagnostics
from bt_agents_language.files import folder_reader
from bt_agents_language.files.scene_reader import read_scene
from bt_agents_language.files.script_reader import read_script
from bt_agents_language.files.skills_reader import read_skills
from bt_agents_language.files.testing.test_reader import read_test
from bt_agents_language.nodes.plugin_discovery import read_plugins
from bt_agents_language.nodes.symbols import SymbolTable
from bt_agents_language.reference.codes import Code, ExampleKind, code_groups, codes
from bt_agents_language.tools import folder_check
from bt_agents_language.tools.folder_check import check_folder
from bt_agents_language.tools.lint import cut_texts, lint
from bt_agents_language.yaml.source import read_source
from bt_agents_language.yaml.yaml_reader import Mapping
from bt_agents_language.yaml.yaml_reader import read_document as read_file
from fake_interfaces import FakeInterfaces
from file_texts import read_agent_text
from tree_harness import SPACE, SYMBOLS, TREES

HEAD = {
    "format": "format: 1",
    "agent": "agent: {stem}",
    "profile": "profile: {{age: 3, familiarity: 3, mood: 3}}",
    "tree": "tree: {{wait: 1 s}}",
}
FILE = re.compile(r"^# (\S+\.yaml)(/?)$", re.MULTILINE)
ROOT = Path(__file__).parents[3]
TABLE = ROOT / "bt_agents_language" / "bt_agents_language" / "reference" / "codes.yaml"
CODES = codes()
SHOWN = [code for code in CODES.values() if code.wrong]


class StandardTypes(FakeInterfaces):
    """Knows every type but std_msgs/msg/Boolean, and every field but 'value'."""

    def type_problem(self, kind: BindingKind, type_name: str) -> str | None:
        return "no such type" if type_name.endswith("/Boolean") else None

    def field_problem(
        self, kind: BindingKind, type_name: str, section: str, path: str
    ) -> str | None:
        return "no such field" if path == "value" else None


def agent_file(example: bytes, stem: str = "guide") -> bytes:
    """Return an example preceded by the parts that every agent needs."""
    there = re.findall(rb"^(\w+):", example, re.MULTILINE)
    missing = [line for key, line in HEAD.items() if key.encode() not in there]
    return "".join(f"{line.format(stem=stem)}\n" for line in missing).encode() + example


def put(path: Path, data: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def of_agent(example: bytes, folder: Path) -> tuple[Diagnostic, ...]:
    source = read_source(put(folder / "guide.yaml", agent_file(example)))
    symbols = SymbolTable(space=SPACE, skills=SYMBOLS.skills, interfaces=StandardTypes())
    return (*lint(read_agent_text(source.text, source.file, symbols)), *cut_texts(source))


def of_test(example: bytes, folder: Path) -> tuple[Diagnostic, ...]:
    agent = read_agent_text(agent_file(b"tree: {say: Hello.}").decode(), "g.yaml", SYMBOLS)
    read_test(put(folder / "guide.test.yaml", b"format: 1\n" + example), [agent], SYMBOLS)
    return ()


def of_folder(example: bytes, folder: Path) -> tuple[Diagnostic, ...]:
    for name in ("scene.yaml", "skills/robot.yaml"):
        put(folder / name, (TREES / name).read_bytes())
    parts = FILE.split(example.decode())
    if parts[1].startswith(("skills/", "libraries/")):
        put(folder / "agents" / "other.yaml", agent_file(b"", "other"))
    for name, is_folder, text in zip(parts[1::3], parts[2::3], parts[3::3], strict=True):
        if is_folder:
            (folder / name).mkdir(parents=True)
            continue
        data = text.lstrip("\n").encode()
        if name.startswith("agents/") and data.strip():
            data = agent_file(data, Path(name).stem)
        put(folder / name, data)
    return check_folder(folder, StandardTypes()).problems


def of_package(example: bytes, folder: Path) -> tuple[Diagnostic, ...]:
    groups = tomllib.loads(example.decode())["project"]["entry-points"]
    points = [
        EntryPoint(name, value, group)
        for group, of_group in groups.items()
        for name, value in of_group.items()
    ]
    plugins = read_plugins(points)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(folder_check, "installed_plugins", lambda: plugins)
        patch.setattr(folder_reader, "installed_plugins", lambda: plugins)
        return check_folder(TREES, StandardTypes(), [TREES / "scene.yaml"]).problems


LOOK: dict[ExampleKind, Callable[[bytes, Path], tuple[Diagnostic, ...]]] = {
    ExampleKind.AGENT: of_agent,
    ExampleKind.TEST: of_test,
    ExampleKind.FOLDER: of_folder,
    ExampleKind.PACKAGE: of_package,
}
READERS: dict[ExampleKind, Callable[[Path], object]] = {
    ExampleKind.SKILLS: lambda path: read_skills([path], StandardTypes()),
    ExampleKind.SCENE: lambda path: read_scene(path, StandardTypes()),
    ExampleKind.SCRIPT: lambda path: read_script(path, SPACE),
    ExampleKind.XML: lambda path: read_document(read_source(path)),
}


MARK = re.compile("⟨(?:(?P<tab>tab)|U\\+(?P<point>[0-9A-F]{4})|byte (?P<byte>[0-9A-F]{2})"
                  "|(?P<unit>.+?) × (?P<times>[0-9,]+))⟩".encode())  # fmt: skip
"""The mark of what an example cannot show."""


def marked(mark: re.Match[bytes]) -> bytes:
    if mark["tab"]:
        return b"\t"
    if mark["point"]:
        return chr(int(mark["point"], 16)).encode()
    if mark["byte"]:
        return bytes([int(mark["byte"], 16)])
    return mark["unit"] * int(mark["times"].replace(b",", b""))


def found(code: Code, example: str, folder: Path) -> tuple[Diagnostic, ...]:
    data = MARK.sub(marked, example.encode())
    try:
        if code.kind in LOOK:
            return LOOK[code.kind](data, folder)
        READERS[code.kind](put(folder / "example.file", data))
    except ReadError as error:
        return error.diagnostics
    return ()


@pytest.mark.parametrize("code", SHOWN, ids=lambda code: code.code)
def test_wrong_example_reports_its_code_first(code, tmp_path):
    problems = found(code, code.wrong, tmp_path)
    assert [problem.code for problem in problems][:1] == [code.code], problems
    assert problems[0].severity is code.severity


@pytest.mark.parametrize("code", SHOWN, ids=lambda code: code.code)
def test_right_example_has_no_problems(code, tmp_path):
    assert found(code, code.right, tmp_path) == ()


def test_code_table_is_valid_with_known_keys():
    source = read_source(TABLE)
    problems = Diagnostics(source)
    _, root = read_file(source, problems)
    assert not problems.sorted()
    assert isinstance(root, Mapping)
    for group in root.entries:
        for entry in group.value.entries:
            keys = [one.key.text for one in entry.value.entries]
            assert keys == [key for key in KEYS if key in keys]
            assert ({*keys} >= {"meaning", "wrong", "right"}) or entry.key.text == "reader-fault"


def test_every_code_belongs_to_one_group():
    assert len(CODES) == sum(map(len, code_groups().values()))
    warnings = {code.code for code in code_groups()["Warnings"]}
    assert warnings == {c.code for c in CODES.values() if c.severity is Severity.WARNING}


KEYS = ("meaning", "file", "severity", "wrong", "right")
"""Keys of a code in the table, in their order."""

REPORTING = {
    "error", "error_in", "_error", "add", "_give_up", "_refuse", "_refusal", "ImportProblem",
    "_at", "warning",
}  # fmt: skip
"""Functions that report a problem; the code is one of their first two arguments."""

CODE = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")


def reported(module: Path) -> Iterator[str]:
    """Yield the codes of problems that a module reports."""
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        given = [keyword.value for keyword in node.keywords if keyword.arg == "code"]
        called = getattr(node.func, "attr", "") or getattr(node.func, "id", "")
        if called in REPORTING and len(node.args) > 1:
            given += node.args[:2]
        texts = [str(one.value) for one in given if isinstance(one, ast.Constant)]
        yield from filter(CODE.fullmatch, texts)


def test_every_reported_code_is_in_the_table():
    packages = ("bt_agents_language", "bt_agents_groot", "bt_agents_tools")
    modules = [path for package in packages for path in (ROOT / package).rglob("*.py")]
    codes = {code for module in modules for code in reported(module)}
    assert len(codes) > 60
    assert codes <= set(CODES)
