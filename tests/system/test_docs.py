"""README, CONTRIBUTING and docs: every block is run or says why not, every link leads somewhere."""

from __future__ import annotations

import importlib.util
import inspect
import re
from pathlib import Path

import pytest
import yaml

from crawler_model import simulate
from crawler_model.run.ticks import DEFAULT_RATE

from ..pages import (
    KNOWN,
    ROOT,
    Block,
    Page,
    anchors,
    blocks,
    compare,
    inline_code,
    links,
    look_up,
    needs_ros,
    pages,
    verbs,
)
from .test_rooms import PACKAGES

NAMES = [str(page.relative_to(ROOT)) for page in pages()]
TEXTS = {name: (ROOT / name).read_text(encoding="utf-8") for name in NAMES}
LONG = ("docs/laboratory.md",)
"""Pages whose commands other tests run, too."""
PAGES = [pytest.param(name, marks=[pytest.mark.slow] if name in LONG else []) for name in NAMES if "```" in TEXTS[name]]


@pytest.mark.timeout(7200)  # a page has many blocks
@pytest.mark.parametrize("name", PAGES)
def test_every_block_runs_or_says_why_not(name, tmp_path):
    page = Page(name, TEXTS[name], tmp_path)
    if needs_ros(page.blocks):
        pytest.importorskip("rclpy")
    page.run()


def test_every_verb_and_option_of_every_page_exists():
    """On pages that take long to run, too."""
    found = 0
    for name, text in TEXTS.items():
        for block in blocks(name, text):
            for said in re.findall(r"^crawler ([^|&;>#\n]+)", block.text.replace("\\\n", " "), re.M):
                if block.language in ("bash", "console"):
                    found += 1
                    assert KNOWN["crawler"](said.split()), f"{block.place}: there is no such thing: crawler {said}"
    assert found > 50


def run(text: str, folder: Path) -> None:
    Page("page.md", text, folder).run()


def fenced(*parts: tuple[str, str]) -> str:
    return "\n".join(f"```{language}\n{text}\n```\n" for language, text in parts)


WRONG = [
    ("nobody knows what to do with a block of toml", fenced(("toml", "a = 1"))),
    ("nobody knows what to do with a block of no kind", fenced(("", "crawler scenes"))),
    ("commands, not equations", fenced(("equations", "crawler scenes"))),
    ("exit status 1", fenced(("console", "crawler simulate nowhere"))),
    ("exit status 1", fenced(("bash", "false\ntrue"))),
    ("exit status 127", fenced(("bash", "crowler scenes"))),
    ("nobody knows crowler", fenced(("bash", "# takes minutes\ncrowler scenes"))),
    ("exit status 127", fenced(("bash", "# takes its time\ncrowler scenes"))),
    ("there is no such thing: make tea", fenced(("bash", "# takes minutes\nmake tea"))),
    ("there is no such thing: crawler fly", fenced(("bash", "# takes minutes\ncrawler fly"))),
    ("there is no such thing: crawler warm --fast", fenced(("bash", "# takes minutes\ncrawler warm --fast"))),
    (
        "there is no such thing: ros2 run",
        fenced(("bash", "# needs a ROS 2 installation\nros2 run crawler_ros fly")),
    ),
    ("there is no such thing: pip install", fenced(("bash", "# needs a network\npip install -e '.[tea]'"))),
    ("shows what no block before it printed", fenced(("text", "hello"))),
    ("but this was printed", fenced(("bash", "echo hello"), ("text", "good-bye"))),
    ("ZeroDivisionError", fenced(("python", "1 / 0"))),
    ("NameError", fenced(("python", "a = 1"), ("python", "print(a + b)"))),
    ("x.py is written, but no command takes it", fenced(("python", "# x.py\nprint(1)"))),
    ("unknown key", fenced(("yaml", "name: x\nboddy: 1"))),
    ("a scene has a name", fenced(("yaml", "x: 1"))),
    ("a fence that is not closed", "```bash\ntrue\n"),
]


@pytest.mark.parametrize(("said", "text"), WRONG, ids=[said for said, _ in WRONG])
def test_a_page_that_is_wrong_is_found_out(said, text, tmp_path):
    with pytest.raises((AssertionError, ValueError)) as error:
        run(text, tmp_path)
    assert said in str(error.value)


def test_blocks_of_a_page_follow_one_another(tmp_path):
    scene = "# two.yaml\nname: two\nbody: {contacts: [0, 1], links: {stiffness: 1}}\nfriction: {isotropic: 1}"
    run(
        fenced(
            ("yaml", scene),
            ("python", "# say.py\nimport sys\nprint(*sys.argv[1:], sep='\\n')"),
            ("bash", "sleep 100 &\npython say.py one two three\nkill %1"),
            ("text", "one\n...\nthree\n..."),
            ("python", "from pathlib import Path\nprint(Path('two.yaml').is_file(), 3.14)"),
            ("python", "assert Path"),
            ("equations", "a = b"),
            ("console", "# takes minutes: ten\nmake demo && crawler warm --workers 2   # it says"),
        ),
        tmp_path,
    )


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("a b", "a   b\n", True),
        ("a b", "ab", False),
        ("a\n...\nc", "a\nb\nb\nc\n", True),
        ("a\n...\nc", "a\nc\n", True),
        ("a\n...", "b\na\n", False),
        ("a\n...", "a\n", True),
        ("...\na", "b\na\n", True),
        ("...\na", "b\na\nb\n", False),
        ("...\na\n...\nb\n...", "a\nb\n", True),
        ("...\nb\n...\na\n...", "a\nb\n", False),
        ("a\n...\na", "a\n", False),
        ("took ... s", "took 0.25 s", True),
        ("took 0.2... s", "took 0.25 s", True),
        ("took 0.3... s", "took 0.25 s", False),
        ("a", "a\nb", False),
    ],
)
def test_dots_stand_for_anything_and_nothing_else_does(shown, printed, same):
    block = Block("page.md:1", 1, "text", shown)
    if same:
        compare(block, printed)
    else:
        with pytest.raises(AssertionError, match=r"page\.md:1.*shows"):
            compare(block, printed)


def test_links_and_pictures_lead_somewhere():
    missing = []
    for name, text in TEXTS.items():
        for link in links(text):
            path, _, anchor = link.partition("#")
            if path.startswith(("http:", "https:", "mailto:")):
                continue
            file = (ROOT / name).parent / path if path else ROOT / name
            if not file.exists() or ROOT not in file.resolve().parents:
                missing.append(f"{name}: {link}")
            elif anchor and anchor not in anchors(file.read_text(encoding="utf-8")):
                missing.append(f"{name}: {link}: no such heading")
    assert missing == []


def test_commands_in_the_text_exist():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    for name, text in TEXTS.items():
        if name == "CHANGELOG.md":  # it also names what is gone
            continue
        for code in inline_code(text):
            words = code.split()
            if (
                len(words) > 1
                and words[0] == "crawler"
                and words[1] not in ("VERB", "--help", "--version", "--install-completion")
            ):
                assert words[1] in verbs(), f"{name}: {code}"
                assert {w.split("=")[0] for w in words if w.startswith("--")} <= {*verbs()[words[1]], "--help"}, code
            elif len(words) == 2 and words[0] == "make":
                assert words[1] in targets, f"{name}: {code}"


def test_what_contributors_and_designers_are_sent_to_is_there():
    source = "\n".join(
        file.read_text(encoding="utf-8") for top in SOURCES for file in sorted((ROOT / top).rglob("*.py"))
    )
    words = set(re.findall(r"\w+", source))
    for name in ("CONTRIBUTING.md", "docs/design.md"):
        for code in inline_code(TEXTS[name]):
            if re.fullmatch(r"[\w./]+\.(py|yaml|toml|md)|\w+(/\w+)+/?", code) and not code.startswith("/"):
                assert (ROOT / code).exists(), f"{name}: {code}"
            elif re.fullmatch(r"_?[A-Za-z]+(_\w+)?", code):
                assert code in words or (ROOT / code).exists(), f"{name}: {code}"


SOURCES = (*PACKAGES, "tests", "docs")


def test_a_reason_is_a_comment_that_readers_see():
    for name, text in TEXTS.items():
        for block in blocks(name, text):
            if block.reason:
                assert block.language in ("bash", "console", "python")
                look_up(block)


def test_the_references_are_what_the_generator_writes():
    spec = importlib.util.spec_from_file_location("generate", ROOT / "docs" / "generate.py")
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    written = dict(generate.generated())
    assert {file.name for file in written} >= {"scenes.md", "topics.md", "parameters.md", "command.md", "python.md"}
    for file, text in written.items():
        assert file.read_text(encoding="utf-8") == text, f"{file}: `make docs` writes it anew"


def test_a_node_ticks_at_the_rate_of_python_and_of_the_commands():
    parameters = yaml.safe_load((ROOT / "msgs_config" / "simulator.yaml").read_text(encoding="utf-8"))
    assert parameters["rate"]["default"] == DEFAULT_RATE == inspect.signature(simulate).parameters["rate"].default


def test_the_picture_of_the_architecture_names_every_room():
    picture = (ROOT / "docs" / "pictures" / "architecture.svg").read_text(encoding="utf-8")
    named = re.findall(r'class="file"[^>]*>([^<]+)<', picture)
    rooms = {package: {f.parent for f in (ROOT / package).rglob("__init__.py")} for package in PACKAGES}
    folders = {f"{folder.name}/" for found in rooms.values() for folder in found if folder.parent != ROOT}
    assert set(named) == folders | {"launch/", "scenes/", "topics.yaml", "simulator.yaml"}
    for package in PACKAGES:
        assert re.search(rf'class="name"[^>]*>{package}<', picture), package


def test_the_design_names_every_room():
    listed = re.findall(r"^\| `([a-z_/]+/)` \|", TEXTS["docs/design.md"], re.M)
    for package in PACKAGES:
        folders = {f.parent.relative_to(ROOT).as_posix() + "/" for f in (ROOT / package).rglob("__init__.py")}
        assert folders <= set(listed), package
    assert len(listed) == len(set(listed))
    assert all((ROOT / folder).is_dir() for folder in listed)
