"""A claim of the paper, or of ours, with the rule that judges it."""

from dataclasses import dataclass

from paperrepro.claims.verdicts import Rule
from paperrepro.published import Published

#: A claim made in words, without a value; a claim that only this project makes.
STATEMENT, OURS = "statement", "ours"


@dataclass(frozen=True)
class Claim:
    """``text`` in our words, ``place`` in the paper; ``paper`` its value where one is printed.

    ``kind`` as in `published`, or `STATEMENT` or `OURS`. A ``headline`` is in the short table.
    """

    id: str
    text: str
    place: str
    rule: Rule
    paper: Published | None = None
    kind: str = STATEMENT
    headline: bool = False


def valued(
    id: str, text: str, paper: Published, rule: Rule, place: str = "", headline: bool = False
) -> Claim:
    """A claim with a printed value, at its place and of its kind unless another is given."""
    return Claim(id, text, place or paper.place, rule, paper, paper.kind, headline)


def ours(id: str, text: str, place: str, rule: Rule, headline: bool = False) -> Claim:
    return Claim(id, text, place, rule, None, OURS, headline)


def called(scenario: str) -> str:
    """How the paper calls a scenario."""
    return "[11]" if scenario == "SL" else scenario
