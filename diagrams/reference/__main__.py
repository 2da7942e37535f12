"""Prints the reference page as Markdown: `python -m drake_cafim.diagrams.reference > diagrams/reference.md`."""

from drake_cafim.diagrams.reference.page import page

if __name__ == "__main__":
    print(page(), end="")
