"""The numbers that the page «What floquid reaches» shows: measured here, and written to where the page reads them."""

import re

import pytest
from benchmarks.validation import PAGE, ROOT, SECTIONS, write


@pytest.mark.parametrize("section", SECTIONS)
def test_a_section_is_measured(section):
    assert "nan" not in write(section)


def test_the_page_shows_each_section_and_each_has_its_commit():
    page = (ROOT / "docs" / "validation.md").read_text(encoding="utf-8")
    assert set(re.findall(r"literalinclude\} validation/(\w+)\.txt", page)) == set(SECTIONS)
    for section in SECTIONS:
        last = (PAGE / f"{section}.txt").read_text(encoding="utf-8").splitlines()[-1]
        assert re.fullmatch(r"# at commit [0-9a-f]{7,}(, and changes)?", last)
