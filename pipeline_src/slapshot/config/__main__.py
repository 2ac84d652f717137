"""`python -m slapshot.config schema`: the configuration as a JSON schema, for editors and for reading."""

import argparse
import sys
from typing import Any

import yaml

from slapshot.config.configuration import Configuration

_HEAD = """\
# What a configuration may hold, for editors and for reading. Made from the models in slapshot.config:
# python -m slapshot.config schema > workflow/schemas/config.schema.yaml
"""


def schema_text() -> str:
    """The schema of the models, as YAML."""
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **_plain(Configuration.model_json_schema()),
    }
    return _HEAD + yaml.safe_dump(
        schema, sort_keys=False, default_flow_style=None, width=110, allow_unicode=True
    )


def _plain(schema: Any) -> Any:
    """Remove redundant parts of a schema: titles, which repeat the keys, and null for optional keys.

    Mappings with patterns for their keys accept no other keys.
    """
    if isinstance(schema, list):
        return [_plain(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    keys = {key: _plain(value) for key, value in schema.items()}
    if isinstance(keys.get("title"), str):
        del keys["title"]
    if "default" in keys and keys["default"] is None:
        del keys["default"]
    return keys | {"additionalProperties": False} if "patternProperties" in keys else keys


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m slapshot.config", description=__doc__)
    parser.add_argument("what", choices=["schema"])
    parser.parse_args()
    sys.stdout.write(schema_text())


if __name__ == "__main__":
    main()
