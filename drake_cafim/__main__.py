"""`python -m drake_cafim`: the same as the console script `cafim`."""

from drake_cafim.cli import run_cli

if __name__ == "__main__":
    run_cli()
