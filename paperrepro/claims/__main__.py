"""``python -m paperrepro.claims figures/study.csv figures/sweep.csv README.md`` renews the short
table in the last of these files from the rows of the others."""

import sys

from paperrepro.claims import ledger, markdown_summary, update_between_markers
from paperrepro.montecarlo import read_study

if __name__ == "__main__":
    *studies, text = sys.argv[1:]
    changed = update_between_markers(text, "claims", markdown_summary(ledger(read_study(*studies))))
    print(f"{text}: {'renewed' if changed else 'as it was'}")
