"""Calibration of p-values and intervals: how many recordings, and of what."""

from typing import Annotated, Literal

from pydantic import Field

from slapshot.config.values import Duration, Few, Name, Seed, Several, SomeOf
from slapshot.validation import Model

Episodes = Annotated[int, Field(ge=5, le=1_000)]  # one in five is held out
Recordings = Annotated[int, Field(ge=1, le=100_000)]


class Session(Model):
    """How long recordings are."""

    episodes: Episodes = Field(description="of a recording")
    seconds: Duration = Field(description="length of an episode")


class Blocks(Session):
    """Recordings that are made in blocks."""

    recordings: Recordings = Field(description="of each rig, or of each variant of an effect")
    block: Few = Field(description="recordings of one version")


class Block(Session):
    """Which recordings one version has: `count` of them, from number `first` on."""

    first: Annotated[int, Field(ge=0)]
    count: Few


class NullRig(Model):
    """A rig that conceals nothing."""

    rig: Name = Field(description="of the joint lab: pendulum, arm or kuka")
    noise: SomeOf[Literal["white", "ou20", "ou100"]] = Field(
        description="colour of the encoders' noise; recordings take turns"
    )
    seed: Seed = Field(description="of the first recording; each further one has the next")


class Nulls(Blocks):
    """Null recordings, on which p-values must be uniform."""

    rigs: Annotated[dict[Name, NullRig], Field(min_length=1, max_length=100)] = Field(
        description="name in the table -> rig"
    )


class NullBlockSettings(NullRig, Block):
    """What the stage `null_p_values` is told; `name` is the rig's in the table."""

    name: Name


class Coverage(Blocks):
    """Recordings of every effect's own law, of which intervals must hold the true value."""

    seed: Seed = Field(description="of each law's first recording; each further one has the next")
    effects: Several[Name] = Field(description="that are calibrated; the whole catalogue if empty")


class LawBlockSettings(Block):
    """What the stage `law_intervals` is told."""

    effect: Name
    seed: Seed


class TableSettings(Model):
    """What the stages of tables are told: the blocks, in their order."""

    blocks: list[str]


class Calibration(Model):
    """Whether p-values are uniform on nulls, and whether 90 % intervals hold 90 %."""

    nulls: Nulls = Field(description="recordings of `snakemake nulls`")
    coverage: Coverage = Field(description="recordings of `snakemake joint_coverage`")
