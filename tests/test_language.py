"""One language: what is printed, documented and named uses the field's terms, not the project's former words."""

import ast
import io
import re
import tokenize
from pathlib import Path

import greybox_id as gb

ROOT = Path(__file__).parents[1]
FORMER = {
    r"hardly tells?\b|mostly prior": "weakly identifiable; dominated by the prior",
    r"(told|tells?) only together|determined together|told only in combination": "identifiable only in combination",
    r"\buntold\b|\btold in\b|(recording|prior|slip) (does not )?tells? (it|them)\b": "identifiable, informs",
    r"\b(is|are|was|be) (not )?told (apart|by|together|there|in)\b|\btold apart\b": "distinguished, identifiable",
    r"wants something else": "conflicts with the prior: suspect the model structure",
    r"holding the last reading|last.reading.held": "persistence",
    r"\bdepart(s|ed)?\b": "deviates",
    r"something at work|outside the named effects|no name among": "an unmodelled effect",
    r"\bstand-ins?\b|in its place would close": "effects that would mimic it",
    r"would not show here|what would not show": "below the detection limit",
    r"taken up by (tolerances|free parameters)": "absorbed by",
    r"anywhere alike": "evenly spread",
    r"closes the excess by": "reduces the excess error by",
    r"\bbeliefs?\b|\bbelieve[sd]?\b": "prior, trusts",
    r"\bpromise[sd]?\b|\ba price\b": "expected gain, cost",
    r"\bpolished\b": "refined",
    r"(shorten|damp)[\"'] *[,)]": "line_search, levenberg_marquardt",
    r"\bsa(id|ys) by a recurrent": "predicted by",
    r"Tyres are a word": "choose the tyre model with",
    r"late commands": "input delays",
    r"\bthe house\b": "how the code is organised",
    r"\b[Ll]eav(e|es|ing) [^.\n]{1,30} away\b|left away": "omit",
    r"always the same goes": "defaults live in",
    r"(?-i:\bHand on\b|[\"']Watch[\"'])": "Deploy, Estimate",
    r"residuals still (tell|say)": "residual analysis",
    r"taken for nothing": "unused columns",
}
"""What was said -> what is said. The words are those of statsmodels, lmfit, MATLAB's toolbox and ISO 8855."""


def texts():
    """What people read: texts of the package that are no docstrings, those of commands (their help), its documents."""
    for file in sorted(file for package in ("greybox_id", "greybox_lab") for file in (ROOT / package).rglob("*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        helps = "cli" in file.parts or file.stem == "command"
        silent = set() if helps else {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in silent:
                yield f"{file.relative_to(ROOT)}:{node.lineno}", node.value
    for file in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))):
        yield str(file.relative_to(ROOT)), file.read_text(encoding="utf-8")


def public():
    """Names at the top level and what is documented of them."""
    for name in gb.__all__:
        own = getattr(gb, name)
        yield f"gb.{name}", own.__doc__ or ""
        for inner in vars(own) if isinstance(own, type) else ():
            if not inner.startswith("_"):
                yield (
                    f"gb.{name}.{inner}",
                    f"{inner.replace('_', ' ')} {getattr(vars(own)[inner], '__doc__', '') or ''}",
                )


def test_former_words_do_not_come_back():
    found = [
        f"{place}: {match[0]!r}; say: {now}"
        for place, text in (*texts(), *public())
        for former, now in FORMER.items()
        for match in re.finditer(former, text, re.IGNORECASE)
    ]
    assert found == []


def test_a_former_word_is_found():
    assert any(re.search(former, "mostly prior: this recording hardly tells it") for former in FORMER)
    assert any(re.search(former, "Holding the last reading", re.IGNORECASE) for former in FORMER)
    assert not any(re.search(former, "The simulation deviates; the front tyres are stiffer.") for former in FORMER)


DIALECT = {"own", "found", "told", "said", "asked", "wanted"}
"""Identifiers that name nothing of the field; `docs/glossary.md` says what to write."""
LEFT = 125
"""How many are left in the library and the laboratory: attributes, keywords and names at the top of modules."""


def test_identifiers_are_the_fields_words():
    places = [
        f"{file.relative_to(ROOT)}:{token.start[0]} {token.string}"
        for package in ("greybox_id", "greybox_lab")
        for file in sorted((ROOT / package).rglob("*.py"))
        for token in tokenize.generate_tokens(io.StringIO(file.read_text(encoding="utf-8")).readline)
        if token.type == tokenize.NAME and token.string in DIALECT
    ]
    assert len(places) <= LEFT, places
