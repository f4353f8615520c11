"""The list of checks: each kind of record is asked what it can answer, and the page says so."""

import re
from pathlib import Path

import numpy as np
import pytest

from floquid.checks import CHECKS, Ambient, Check, Criterion, Decays, Driven, Evidence, Validation
from floquid.checks._check import REMAINDER, Subject, looked_at
from floquid.findings import failure, warning
from floquid.findings._finding import WORDS

KINDS = (Decays, Driven, Ambient)
PAGE = Path(__file__).parents[3] / "docs" / "verdict.md"


def table():
    """The rows of the page's table of checks, by name."""
    rows = [[own.strip() for own in line.strip("|").split("|")] for line in PAGE.read_text("utf-8").splitlines()]
    return {row[0]: row[1:] for row in rows if len(row) == 7 and row[-1].startswith("`_")}


def file_of(check):
    """The module of a check, or of the method of the kind that answers it."""
    look = check.look or next(getattr(kind, check.needs) for kind in KINDS[::-1] if check.answered(kind))
    return look.__module__.rsplit(".", maxsplit=1)[-1]


def test_the_page_has_each_check_with_its_kinds_and_its_file():
    asked = {}
    for check in CHECKS:
        said = ["verdict" if check.name in kind.of_verdict else "finding" for kind in KINDS]
        said = [word if check.answered(kind) else "" for word, kind in zip(said, KINDS, strict=True)]
        asked[check.name] = [check.question, *said, f"`{file_of(check)}.py`"]
    assert {name: [*row[:4], row[-1]] for name, row in table().items()} == asked


def test_every_code_on_the_page_has_words():
    codes = {code for row in table().values() for code in re.findall(r"`(\w+)`", row[4])}
    assert len(codes) > 30
    assert codes <= set(WORDS)


@pytest.mark.parametrize("kind", KINDS)
def test_a_verdict_is_of_checks_that_its_kind_can_answer(kind):
    assert kind.of_verdict <= {check.name for check in CHECKS if check.answered(kind)}


class Asked(Subject):
    """A kind that answers two checks, one of them for its verdict."""

    of_verdict = frozenset({"size"})
    shape = (1, 1)

    def sized(self):
        return 2.0

    def seen(self):
        return 1


def of_size(subject, evidence):
    kept = evidence.kept("size", subject.sized(), 1.0, failing=3.0)
    return () if kept else evidence.against("line_left", "size", share=0.02, frequencies=(), sizes=())


LIST = (
    Check("size", "?", "sized", of_size),
    Check("seen", "?", "seen", lambda *_: (warning("growing", number=1, order=2),)),
    Check("other", "?", "unanswered", lambda *_: pytest.fail("asked")),
)


def test_a_verdict_without_a_share_passes_whatever_was_noted():
    nothing = np.full((1, 1), np.nan)
    lines = np.zeros((1, 1, 0))
    criteria, findings = {"held_out_error": Criterion(limit=1.5)}, (warning("no_second_harmonic"),)
    own = Validation(
        metrics={"held_out_error": 1.0}, criteria=criteria, passed=True, findings=findings,
        fit=nothing, held_out_error=nothing, colour=nothing, tones=lines, lines=lines,
    )  # fmt: skip
    assert own.answer == "passes"


def test_a_kind_is_asked_what_it_can_answer_and_its_verdict_apart():
    apart = looked_at(Asked(), LIST, verdict=False)
    assert [own.code for own in apart.findings] == ["growing"]
    assert not apart.metrics
    verdict = looked_at(Asked(), LIST, verdict=True).verdict((1, 1))
    assert [(own.code, own.severity.value) for own in verdict.findings] == [("line_left", "warning")]
    assert (verdict.passed, verdict.unmet) == (True, ("size",))


@pytest.mark.parametrize(("share", "value", "fails"), [(0.0, 2.0, False), (0.06, 2.0, True), (0.0, 3.1, True)])
def test_what_is_left_is_a_remainder_up_to_a_limit(share, value, fails):
    evidence = Evidence()
    assert not evidence.kept("size", value, 1.0, failing=3.0)
    (said,) = evidence.against("line_left", "size", share=share, frequencies=(), channels=(), hits=(), sizes=())
    assert (said.severity.value == "failure") is fails
    assert evidence.remainder == share
    evidence.findings.append(said)
    assert evidence.kept("remainder", evidence.remainder, REMAINDER) is not (share > REMAINDER)
    answer = "fails" if fails else "passes with a remainder of less than 0.1 %"
    assert evidence.verdict((1, 1)).answer == answer


def test_no_number_is_no_verdict_in_favour():
    missing = Evidence()
    missing.findings += missing.missing({"fit": 0.95}, failure("held_out_too_few"))
    assert not missing.verdict((2, 1)).passed
    assert not Evidence(findings=[failure("not_checked", error="x")]).verdict((2, 1)).passed
    assert Evidence().kept("size", float("nan"), 1.0)  # said by a finding of its own
