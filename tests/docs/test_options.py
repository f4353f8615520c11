"""The page of options is that of the settings as they are."""

from tests.docs.options import PAGE, page


def test_the_page_of_options_is_up_to_date():
    assert PAGE.read_text(encoding="utf-8") == page(), "write it again: python -m tests.docs.options"
    rows = [line for line in page().splitlines() if line.startswith("| `")]
    assert all(line.count(" | ") == 5 for line in rows)
    assert any(" | no: " in line for line in rows)
