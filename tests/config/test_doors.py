"""Every door that takes a configuration prints the same line about a bad one, and goes no further."""

import sys
from pathlib import Path

import pytest
from workspace import Workspace, copy_repository

SLAPSHOT = ("-c", "from slapshot.cli import main; main()")
BEGINNING = "name: my\ndomains:\n  hockey:\n"


@pytest.fixture(scope="module")
def copied(tmp_path_factory) -> Workspace:
    return copy_repository(tmp_path_factory.mktemp("doors"))


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            f"{BEGINNING}    seed: 1\n    seed: 2\n",
            "bad.yaml:5: not valid YAML (key 'seed' stands there twice); mend that line",
        ),
        (
            f"{BEGINNING}    training: {{steps: many}}\n",
            "bad.yaml:4: domains.hockey.training.steps: 'many' is not a whole number; write a whole number "
            "(of the optimiser)",
        ),
        (
            f"{BEGINNING}    latents:\n      methods:\n      - gru\n",
            "bad.yaml:6: domains.hockey.latents.methods.0: 'gru' is not among the domain's methods; "
            "use one of: kalman, lstm, maml_1, maml_4, maml_8",
        ),
        (
            "cases: {small: nowhere.csv}\n",
            "bad.yaml:1: cases.small: nowhere.csv: no such file; name a list of cases (CSV), such as "
            "config/cases/small.csv",
        ),
    ],
    ids=["twice", "type", "method", "cases"],
)
def test_the_same_line_at_every_door(copied, text, line):
    (copied.root / "bad.yaml").write_text(text)
    done = copied.python(*SLAPSHOT, "config", "bad.yaml")
    assert (done.stdout, done.returncode) == (f"slapshot: {line}\n", 1)
    # Snakemake calls it by its absolute path.
    done = copied.run(
        sys.executable, "-m", "snakemake", "--dry-run", "--configfile", copied.root / "bad.yaml"
    )
    assert done.stdout.splitlines().count(line) == 1
    assert "Traceback" not in done.stdout
    assert done.returncode == 1


def test_commands_that_take_a_configuration_check_it_first(copied):
    (copied.root / "bad.yaml").write_text(f"{BEGINNING}    figures: [F99]\n")
    line = "bad.yaml:4: domains.hockey.figures.0: 'F99' cannot be made here; use some of: "
    for command in (
        (*SLAPSHOT, "versions", "why", "rollouts"),
        (*SLAPSHOT, "versions", "gc", "--yes"),
        (*SLAPSHOT, "stage", "rollouts"),
    ):
        done = copied.python(*command, "--config", "bad.yaml")
        assert done.stdout.partition(" ")[2].startswith(line)
        assert done.stdout.count("\n") == 1
        assert done.returncode == 1
    assert not (copied.root / "data/store").exists()


def test_make_checks_the_configuration_first(copied):
    (copied.root / "Makefile").write_text((Path(__file__).parents[2] / "Makefile").read_text())
    (copied.root / "my file.yaml").write_text("name: -rf\n")
    environment = f"PATH={Path(sys.executable).parent}:/usr/bin:/bin"
    # Whoever runs these tests by make is told of every make within it.
    alone = ("env", "-u", "MAKELEVEL", "-u", "MAKEFLAGS", "-u", "MFLAGS", environment)
    done = copied.run(*alone, "make", "--old-file=setup", "figures", "CONFIG=my file.yaml")
    assert done.stdout.splitlines()[0].startswith(
        "slapshot: my file.yaml:1: name: '-rf' is not allowed; use letters"
    )
    assert "snakemake" not in done.stdout
    assert done.returncode == 2


def test_what_the_command_line_says_is_in_no_file(copied):
    command = (sys.executable, "-m", "snakemake", "--dry-run", "--config")
    done = copied.run(*command, "name=-rf")
    assert "\n--config: name: '-rf' is not allowed; use letters, digits, _ and -, the first a" in done.stdout
    done = copied.run(*command, "name=my", "--configfile", "config/tiny.yaml")
    assert done.returncode == 0
