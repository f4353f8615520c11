"""Results say their kind by a field: few modules ask for the class of one, and each for a reason that is here."""

import ast

from tests.architecture.test_clocks import names_in, sources

import floquid

RESULTS = {
    kind.__name__
    for room in ("comparison", "floquet", "large", "monitoring", "order", "pipeline", "surveys", "transfer")
    for kind in vars(getattr(floquid, room)).values()
    if isinstance(kind, type) and isinstance(getattr(kind, "kind", None), str)
}

ASKING = {
    "comparison/_update.py": "one survey stands for itself among several results",
    "surveys/_points.py": "modes of a known system, in its states, are read as a model",
    "transfer/_fit.py": "lines as measured have a period, plain ones have none",
    "views/_sidebands.py": "a model answers at any frequency, lines at their own",
}


def asks_for_a_result(text):
    """True where code goes different ways by the class of a result; to refuse an argument is not to ask."""
    tree = ast.parse(text)
    refusing = (node for node in ast.walk(tree) if isinstance(node, ast.If))
    refusing = (node for node in refusing if any(isinstance(own, ast.Raise) for own in node.body))
    passed_over = {own for node in refusing for own in ast.walk(node.test)}
    asked = (
        names_in(node.args[1]) if isinstance(node, ast.Call) else names_in(node.cls)
        for node in ast.walk(tree)
        if node not in passed_over
        and (
            isinstance(node, ast.MatchClass)
            or (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "isinstance")
        )
    )
    return any(names & RESULTS for names in asked)


def test_few_modules_ask_for_the_class_of_a_result():
    assert {"Analysis", "Survey", "MeasuredTransfer", "LargeResult"} <= RESULTS
    assert {name for name, text in sources(RESULTS).items() if asks_for_a_result(text)} == set(ASKING)


def test_one_that_asks_would_be_found():
    refused = "if not isinstance(found, Survey):\n    raise TypeError\n"
    assert not asks_for_a_result(refused + "isinstance(found, Record)\nfound.kind == 'survey'\n")
    assert asks_for_a_result(refused + "x = 1 if isinstance(found, (Survey, str)) else 2\n")
    assert asks_for_a_result("match found:\n    case pipeline.Analysis():\n        pass\n")
