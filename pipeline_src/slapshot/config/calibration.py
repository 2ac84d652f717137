"""Calibration of p-values and intervals: the number and kind of recordings."""

from typing import Annotated, Literal

from pydantic import Field

from slapshot.config.values import Duration, Few, Hits, Name, Seed, Several, SomeOf
from slapshot.validation import Model

Episodes = Annotated[int, Field(ge=5, le=1_000)]  # one in five is held out, hence at least five
Recordings = Annotated[int, Field(ge=1, le=100_000)]


class Session(Model):
    """Length of recordings."""

    episodes: Episodes = Field(description="of each recording")
    seconds: Duration = Field(description="length of an episode")


class Blocks(Session):
    """Recordings that are generated in blocks."""

    recordings: Recordings = Field(description="for each rig, or for each variant of an effect")
    block: Few = Field(description="recordings per job")


class Block(Session):
    """The recordings of one job: `count` of them, from number `first` on."""

    first: Annotated[int, Field(ge=0)]
    count: Few


class NullRig(Model):
    """A rig without hidden effects."""

    rig: Name = Field(description="rig of the joint lab: pendulum, arm or kuka")
    noise: SomeOf[Literal["white", "ou20", "ou100"]] = Field(
        description="colours of the encoders' noise; recordings take them in turn"
    )
    seed: Seed = Field(description="of the first recording; it increases by 1 per recording")
    cluttered: bool = Field(
        default=False,
        description="whether laws err by 10 %, times jitter, noise has outliers and grows, readings drift",
    )


class Nulls(Blocks):
    """Recordings without hidden effects, for which p-values must be uniform."""

    rigs: Annotated[dict[Name, NullRig], Field(min_length=1, max_length=100)] = Field(
        description="name in the table -> rig"
    )


class NullBlockSettings(NullRig, Block):
    """Settings of the stage `null_p_values`; `name` is that of the rig in the table."""

    name: Name


class Coverage(Blocks):
    """Recordings simulated with each effect's own model, for which intervals must cover the true value."""

    seed: Seed = Field(description="of each effect's first recording; it increases by 1 per recording")
    effects: Several[Name] = Field(description="effects to calibrate; the whole catalogue if empty")


class LawBlockSettings(Block):
    """Settings of the stage `law_intervals`."""

    effect: Name
    seed: Seed


class HitCoverage(Model):
    """Recordings of hits simulated with each effect's own law; intervals must cover the true value."""

    seed: Seed = Field(description="of each effect's first recording; it increases by 1 per recording")
    recordings: Recordings = Field(description="for each effect")
    block: Few = Field(description="recordings per job")
    hits: Hits = Field(description="of each recording")
    effects: SomeOf[Name] = Field(description="of slide, camera or session, but for maps of bumps")


class HitBlockSettings(Model):
    """Settings of the stage `hit_intervals`: `count` recordings, from number `first` on."""

    effect: Name
    seed: Seed
    hits: Hits
    first: Annotated[int, Field(ge=0)]
    count: Few


class TableSettings(Model):
    """Settings of the stages that make tables: the blocks, in order."""

    blocks: list[str]


class Calibration(Model):
    """Uniformity of p-values without hidden effects, and coverage of 90 % intervals."""

    nulls: Nulls = Field(description="recordings of `snakemake nulls`")
    coverage: Coverage = Field(description="recordings of `snakemake joint_coverage`")
    hit_coverage: HitCoverage = Field(description="recordings of `snakemake hit_coverage`")
