"""Print the catalogue of effects as a table: python -m slapshot.effects."""

from slapshot.effects.table import as_markdown

if __name__ == "__main__":
    print(as_markdown(), end="")
