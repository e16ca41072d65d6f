"""``python -m paperrepro.claims figures/study.csv README.md`` renews the short table in a file."""

import sys

from paperrepro.claims import ledger, markdown_summary, update_between_markers
from paperrepro.montecarlo import read_study

if __name__ == "__main__":
    study, text = sys.argv[1:]
    changed = update_between_markers(text, "claims", markdown_summary(ledger(read_study(study))))
    print(f"{text}: {'renewed' if changed else 'as it was'}")
