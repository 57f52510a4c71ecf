"""The README does what it says: its Python runs, its commands exist, and what it shows is what they print."""

import re

from doors import ROOT, block_in, blocks
from reader import Reader, shape

README = (ROOT / "README.md").read_text()


def test_shell_blocks_run(reader: Reader) -> None:
    """The setup and the test command are what brought us here; the others run with less effort."""
    (reader.folder / "mine.py").write_text(block_in(README, "python"))
    shell = [line for kind, block in blocks(README) if kind == "sh" for line in block.splitlines()]
    lines = [line for line in shell if line.startswith("sepv ")]
    assert lines
    for line in lines:
        few = "--examples 2 --paths 64 --shrink-checks 10" + ("" if "--law" in line else " --law energy")
        command, remark = line.partition("  #")[::2]
        assert "holds" in reader.sepv(f"{command} {few}  #{remark}")


def printed(output: str) -> set[str]:
    """The lines of an output, and each without its numbers."""
    lines = [" ".join(line.split()) for line in output.splitlines()]
    return {*lines, *map(shape, lines)}


def test_every_output_that_is_shown_is_printed(reader: Reader) -> None:
    """Each text block stands after its command; its case is compared digit by digit, other lines but for numbers."""
    (reader.folder / "mine.py").write_text(block_in(README, "python"))
    command, shown = "", list[tuple[str, str]]()
    for kind, block in blocks(README):
        if kind == "text":
            shown.append((command, block))
        elif block.startswith("sepv "):
            command = block.strip()
    assert len(shown) == 2
    for command, block in shown:
        reader.sepv(command)
        there = printed(reader.stdout)
        for line in map(str.strip, block.splitlines()):
            exactly = line.startswith(("H(y) =", "B12(y) =", "y =", "h ="))
            asked = " ".join(line.split())
            assert set(line) <= set("…─") or (asked if exactly else shape(asked)) in there, (command, line)


def test_every_block_of_the_readme_is_of_a_kind_that_is_run_or_compared() -> None:
    kinds = re.findall(r"^```(\w*)$", README, flags=re.MULTILINE)[::2]
    assert set(kinds) == {"sh", "python", "text"}
    ours = ("sepv verify ", "python3 -m venv", "pip install -e '.[test]'", "python -m pytest -n auto")
    for block in (body for kind, body in blocks(README) if kind == "sh"):
        assert all(line.startswith(ours) for line in block.splitlines()), block
